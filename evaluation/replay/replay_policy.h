// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "evaluation/replay/episode_recording.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Outputs of the policy of a checkpoint or policy file for each observation of a recorded episode, which need not be its own: values and
/// probabilities of actions.
PolicyObserver observe_with_policy(const std::filesystem::path& checkpoint, const RunConfig& config);

}  // namespace earshot
