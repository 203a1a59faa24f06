// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "trainer/run/run_config.h"

namespace earshot {

/// How thoroughly scenes are compared: by their names, or also by their geometry (find_scene_overlap), which loads them all once.
enum class HeldOutCheck { names, all };

/// Largest number of scenes of both sets that are compared by geometry; beyond it names decide, and a line says so.
inline constexpr std::size_t kMaxComparedScenes = 200;

/// Refuses held-out episodes that are none; returns at once where config.held_out is off.  remake: command that makes the episode sets
/// anew, for messages.  Throws InputError, one line: the set is missing, was made from other keys, or has scenes of the training set, which
/// are named.  With HeldOutCheck::all a warning names those that it has in common with data.eval.
void check_held_out(const RunConfig& config, const std::string& remake, HeldOutCheck how);

}  // namespace earshot
