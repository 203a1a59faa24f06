// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Quieter than this a band passes nothing (docs/evidence/stability.md, H-69).
inline constexpr double kSilentTransmissionDb = -200.0;

/// Appends what goes straight from source to listener through the walls between them: at most one arrival, of kind transmission, with the
/// number of walls as its order; inserted where `arrivals`, sorted by distance, stays sorted.  Nothing if the line of sight is free (that
/// is the direct sound), if more than config.transmission_walls objects are between them, if no band passes, if it comes after the end of
/// the RIR, or with config.transmission off.  Losses add in dB per band; air absorbs outside the walls only; the delay is that of the
/// material inside one with a speed of its own.  Refraction is left out, as is all but the straight line: reflections through walls are the
/// late field's. Source and listener swapped give the bits of the same distance and amplitudes. Cost: nothing in a scene where no material
/// transmits; otherwise one shadow ray, and one or two rays per wall if it is blocked.  No allocation once `arrivals` has room.
void find_transmitted(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals);
/// The same for a line of sight that is known to be blocked, in a scene whose plan has straight transmission: no shadow ray.
void find_transmitted_behind_walls(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals);

}  // namespace earshot
