// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "envs/batch/batched_env.h"
#include "trainer/learner/rollout_buffer.h"
#include "trainer/rollout/actor.h"
#include "trainer/rollout/episode_window.h"
#include "trainer/rollout/rollout_config.h"
#include "trainer/rollout/stage_times.h"

namespace earshot {

/// Fills the rollouts of one worker: the policy acts, the batch steps, the outcome is recorded.
///
/// With RolloutConfig::overlap the batch is stepped in two halves, each of which has its step in the background while the policy looks at
/// the other one: thread of the policy and threads of the batch work at the same time.  The halves are handed back in the order in which
/// they were sent, so that a run has the same bits each time.  They are not those without overlap: the policy sees half as many rows at
/// once, and sums of products depend on their number in the last bit.
class RolloutCollector {
 public:
  /// env, policy: must outlive this.  first_env: global number of the batch's first env.
  RolloutCollector(const RolloutConfig& config, BatchedEnv& env, PolicyNetwork policy, int first_env);

  /// One rollout of config.rollout_steps steps of all envs.  progress: of the training, for what guides it.  finished: gains the episodes
  /// that ended, but for those in which the oracle acted.  in_step: called once in each step of all envs, with its number from 0; true
  /// makes it the last one of the rollout.
  void collect(double progress, EpisodeSums& finished, StageTimes& times, const std::function<bool(int step)>& in_step = {});
  [[nodiscard]] const RolloutBuffer& rollout() const { return rollout_; }

  /// Before the next step: recurrent state [B, H], and 0 for the envs that begin an episode [B].
  [[nodiscard]] torch::Tensor hidden() const;
  [[nodiscard]] torch::Tensor not_done() const;
  /// 1 for the envs in whose episode the oracle has acted [B]: it does not count as one of the policy's.
  [[nodiscard]] torch::Tensor oracle_acted() const;
  /// oracle_acted: undefined for none.
  void restore(const torch::Tensor& hidden, const torch::Tensor& not_done, const torch::Tensor& oracle_acted);
  /// Since construction.
  [[nodiscard]] std::uint64_t sanitized_rows() const;
  [[nodiscard]] std::uint64_t dropped_rows() const;

 private:
  /// Some envs that step together.
  struct Part {
    int first, count;
    Actor actor;
    RolloutBuffer rollout;  ///< views of their columns
    std::vector<std::int32_t> envs, actions;
    std::vector<ActingEnv> acting;
  };
  void act(Part& part, double progress);
  void note_outcome(Part& part, EpisodeSums& finished);
  torch::Tensor take_oracle_actions(Part& part, double progress);
  [[nodiscard]] std::vector<std::uint8_t> experience(const Part& part) const;

  RolloutConfig config_;
  BatchedEnv& env_;
  int first_env_;
  RolloutBuffer rollout_;
  std::vector<std::uint8_t> oracle_acted_;  ///< by env, in its episode
  std::vector<Part> parts_;
};

}  // namespace earshot
