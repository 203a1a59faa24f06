// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "envs/task/episode.h"

namespace earshot {

/// Seconds from the start of an episode to the end of the last sound of its goal; infinite where a sound of the goal does not end, or the
/// episode names none.  clip_length_s: length of a sound by its name, asked for clips of the goal that are played once; empty if no agent
/// hears: clips then count as endless.
double goal_silent_from_s(const Episode& episode, const std::function<double(const std::string& sound)>& clip_length_s);

}  // namespace earshot
