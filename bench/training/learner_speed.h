// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "trainer/rollout/stage_times.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Means over some updates of one learner, alone on one thread.  A sample is one row of the rollout in one epoch.
struct LearnerSpeed {
  double samples_per_cpu_s = 0, samples_per_s = 0;      ///< by the thread's time on a core, and by the wall
  double forward_ms = 0, backward_ms = 0, step_ms = 0;  ///< of an update, wall: losses, gradients, Adam
  double other_ms = 0;                                  ///< rest of the update
  double actor_rows_per_cpu_s = 0;                      ///< the policy's step on one row of each env
};

/// The learner of a config on a rollout of its shapes: drawn observations, rewards and actions, episodes of kSpeedEpisodeSteps.
class LearnerSpeedTest {
 public:
  explicit LearnerSpeedTest(const RunConfig& config);
  ~LearnerSpeedTest();
  /// Whole updates until `cpu_s` seconds of this thread are gone, one at least, then as many steps of the actor as fit a fourth of that.
  LearnerSpeed measure(double cpu_s);
  void warm_up();
  /// JSON for scripts/bench_learner_torch.py: the same shapes, sizes and settings.
  [[nodiscard]] std::string torch_request(double cpu_s, bool warm_up) const;
  [[nodiscard]] std::int64_t num_parameters() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

inline constexpr int kSpeedEpisodeSteps = 100;

struct TrainingSpeed {
  std::uint64_t steps = 0;
  double wall_s = 0;
  StageTimes stages;  ///< sums over the run, wall
};
/// A short run of the config in one process: collects and learns for `wall_s` seconds, after one update that is not counted; in the first
/// house of data.train with two shared goals, files under `folder`, which must exist.  Throws InputError.
TrainingSpeed measure_training(const RunConfig& config, double wall_s, const std::string& folder);

}  // namespace earshot
