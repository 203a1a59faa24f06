// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "apps/options/timed_path.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Refuses a walk on which a source is inaudible because it or the listener lies outside the closed scene
/// (place_check.h), at any of `times_s`.  Paths in local coordinates; of a source at rest a single pose.  Returns what may be wrong, once
/// for each source.  Throws InputError with the time.  Cost: a ray or three for each source and time, more where a wall comes between.
std::vector<std::string> check_walk_places(const AcousticScene& acoustics, const std::vector<TimedPose>& listener,
                                           const std::vector<std::vector<TimedPose>>& sources, const std::vector<double>& times_s);

}  // namespace earshot
