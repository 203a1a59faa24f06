// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "trainer/held_out/held_out_state.h"
#include "trainer/learner/guidance_config.h"
#include "trainer/learner/ppo.h"
#include "trainer/rollout/episode_window.h"
#include "trainer/rollout/stage_times.h"

namespace earshot {

/// Values that one update adds to the curves, by name: episodes of late, losses, seconds per stage, and what guides the policy where
/// anything
/// does. progress: of the training, in [0, 1].
std::vector<std::pair<std::string, double>> update_curves(const EpisodeSums& recent, const UpdateStats& stats, const StageTimes& times,
                                                          double steps_per_s, const GuidanceConfig& guidance, double progress);

/// What an evaluation adds: success and SPL of either way of acting with their intervals, the best update so far, and the cost.
/// state: behind it.  elapsed_s: of the run, the evaluations included.
std::vector<std::pair<std::string, double>> held_out_curves(const HeldOutScores& scores, const HeldOutState& state, double elapsed_s);

}  // namespace earshot
