// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "envs/batch/quarantine.h"

namespace earshot {

/// Result of running a quarantined episode again.
struct ReplayOutcome {
  std::optional<FaultReport> fault;  ///< of this run; none: the recorded steps went through
  int step = 0;                      ///< at which the fault was found, or steps that went through
  bool recurs = false;               ///< the recorded fault, at the recorded step
  bool same_engine = false;          ///< is this the build that wrote the file?
};

/// Runs the episode again with the recorded config, seed and actions, up to the recorded step.  Its scene and sounds are found by
/// the config, `overrides` ("key=value", as in scene_root=/data) over it.  hook: see StageHook.  Throws InputError if the config cannot
/// be read or the sound is not there.
ReplayOutcome replay(const QuarantineRecord& record, const std::vector<std::string>& overrides = {}, const StageHook& hook = {});

}  // namespace earshot
