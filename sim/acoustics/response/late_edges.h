// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"

namespace earshot {

/// What late sound lacks because traced rays do not bend at edges, at one pose: an estimate without what the lit sides of edges lose.
struct LateEdges {
  /// Late energy that edges bring into shadows in its first or last segment, over all that the rays bring: [num_bands].  Zero without
  /// edges, infinite where rays bring nothing.
  std::vector<double> fraction;
  /// By which that energy would raise the level of late sound, [num_bands]: more than the real change where the field is even.
  [[nodiscard]] std::vector<double> change_db() const;
};

/// By diffuse walks from the source and from the listener, kLateEdgeWalks each.  Where a surface point of a walk does not see the other
/// end, the waves of diffraction_paths.h to it are added up as energies; where it does, the straight line.  The last reflection counts as
/// diffuse.
///
/// The real change is smaller for three reasons.  An even field loses in the light of an edge what goes into its shadow: for a half plane
/// the squared Fresnel integrals give up to 0.199 sqrt(2 / (k r)) rad of shadow filled, and the same angle of light lost, at distance r:
/// the limit for far walls, of which a hall of 24 m has a third to two thirds.  The lost part is not subtracted.  A point on the face of an
/// edge has the wave that the face reflects counted too, up to four times the energy. And the waves of several edges add without phases. It
/// leaves out edges between two reflections, which move energy within the walks: it is no bound where rays miss what edges bring, as in
/// rooms that sound enters over two edges in a row with no wall in sight between (docs/explanation/acoustics.md).
///
/// The fraction is a ratio of the means of few walks, which is too large on average where few of them count.  In open scenes, as before a
/// panel behind a screen, its mean over seeds is 14 to 23 % above the ratio of the means; that is not corrected.
///
/// Standard error: about a tenth of the fraction in a house.  A pure function of the arguments and the seed.  Cost: 0.1 to 0.5 s.
inline constexpr std::uint32_t kLateEdgeWalks = 48;
LateEdges late_edges(const AcousticScene& scene, const SoundSource& source, glm::vec3 listener);

}  // namespace earshot
