// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <span>

#include "trainer/learner/ppo_config.h"

namespace earshot {

/// A worker's rollout in one update.
struct RolloutTime {
  double collect_s = 0;
  int steps = 0;
};

/// When a worker ends its rollout early so that the others do not wait for it (DD-PPO, Wijmans et al. 2020, section 3): after
/// PpoConfig::preempt_least of the steps at least, once PpoConfig::preempt_fraction of the workers have their rollouts.  A worker that is
/// slow also ends it before a step that would be under way when those have theirs, which it takes from the update before: a step of a
/// worker that is four times as slow is four steps of all others.
class Preemption {
 public:
  Preemption(const PpoConfig& config, int rollout_steps);

  [[nodiscard]] bool is_on() const { return fraction_ > 0; }
  /// Whether a rollout may end with this step, counted from 0, if others wait.
  [[nodiscard]] bool may_end_with(int step) const { return is_on() && step + 1 >= least_steps_; }
  /// elapsed_s: since the rollout began, this step included.  num_waiting: other workers that have their rollouts.
  [[nodiscard]] bool ends_with(int step, double elapsed_s, int num_waiting, int world_size) const;
  /// After each update, of all workers.
  void note_update(std::span<const RolloutTime> of_all);
  /// Seconds after which enough workers had all of their steps in the last update; infinite where fewer made all.
  [[nodiscard]] double expected_s() const { return expected_s_; }

 private:
  [[nodiscard]] int required_workers(int world_size) const;

  double fraction_;
  int rollout_steps_, least_steps_;
  double expected_s_ = std::numeric_limits<double>::infinity();
};

}  // namespace earshot
