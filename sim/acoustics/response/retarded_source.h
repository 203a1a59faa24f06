// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <glm/vec3.hpp>

#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Where a source is at a time in seconds, in metres.
using SourcePlaceAt = std::function<glm::dvec3(double t_s)>;

/// When the sound that is heard at heard_s along the straight line has left a source that moves: the t with
/// |listener - place(t)| = c (heard_s - t).  For a source slower than sound, within 1e-9 s; of a faster one nothing is promised.
/// Cost: a few calls of `place` at common speeds, at most 200.  Retarded time: Morse and Ingard, Theoretical Acoustics, 1968, section 11.2.
double emission_time_s(const SourcePlaceAt& place, glm::dvec3 listener, double heard_s, double speed_of_sound_m_per_s);

/// Turns the arrivals from place(emitted_s) into what is heard at heard_s: the sound on each path has left the source by the path's own
/// delay earlier, where the source was then.  Changes distances, amplitudes by the inverse of the distance, and the order by distance.
/// Exact for straight and mirrored paths, whose images move as the source does, within the float of distance_m; for diffracted paths up to
/// the square of the way between the two places over the path's length.  Directions stay those from place(emitted_s).
void retard_arrivals(const SourcePlaceAt& place, double emitted_s, double heard_s, EnergyResponse& response);

}  // namespace earshot
