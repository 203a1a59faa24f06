// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"

namespace earshot {

/// What late sound lacks because traced rays do not bend at edges, at one pose: an upper estimate.
struct LateEdges {
  /// Late energy that goes round edges in its first or last segment, over all that the rays bring: [num_bands].  Zero without edges,
  /// infinite where rays bring nothing.
  std::vector<double> fraction;
  /// By which it would raise the level of late sound at most, [num_bands].
  [[nodiscard]] std::vector<double> change_db() const;
};

/// By diffuse walks from the source and from the listener, kLateEdgeWalks each.  Where a surface point of a walk does not see the other
/// end, the waves of diffraction_paths.h to it are added up as energies; where it does, the straight line.  The last reflection counts as
/// diffuse.
///
/// It is an upper estimate for three reasons.  An even field loses in the light of an edge what goes into its shadow: for a half plane the
/// squared Fresnel integrals give 0.199 sqrt(2 / (k r)) rad of shadow filled, and the same angle of light lost, at distance r.  The lost
/// part is not subtracted.  A point on the face of an edge has the wave that the face reflects counted too, up to four times the energy.
/// And the waves of several edges add without phases.  It leaves out edges between two reflections, which move energy within the walks:
/// it is no bound for rooms that sound enters over two edges in a row with no wall in sight between (docs/explanation/acoustics.md).
///
/// Standard error: about a tenth of the fraction in a house.  A pure function of the arguments and the seed.  Cost: 0.1 to 0.5 s.
inline constexpr std::uint32_t kLateEdgeWalks = 48;
LateEdges late_edges(const AcousticScene& scene, const SoundSource& source, glm::vec3 listener);

}  // namespace earshot
