// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "sim/acoustics/model/acoustic_surfaces.h"

namespace earshot {

/// Decay time of flutter echoes: for each band the longest time, over all pairs of facing planes, in which the sound between the planes
/// falls by `fall_db` relative to the diffuse sound of the room.  Zero without a pair.
///
/// In closed form.  Two planes d apart with a mean specular reflectance R bring 2 / d R^(r / d) / (4 pi r)^2 per metre of path r (images in
/// a row, Allen and Berkley 1979), from the first bounce on; the room between them exp(-k r) / (4 pi V), k by Eyring of the box that six
/// rays see (air_points.h), none under the sky.  The direct sound is left out: what is returned is an upper bound for listeners near the
/// source.  Only planes that send back more than 60 % count, as in FacingPlanes.  Later than `horizon_s` the time is extrapolated.
///
/// Looked for among the 64 largest planes of the scene, from up to four points of the largest triangle of each, on both sides: up to 512
/// rays.
std::vector<double> flutter_times(const AcousticSurfaces& surfaces, std::span<const double> air_energy_per_m, double fall_db,
                                  double horizon_s);

}  // namespace earshot
