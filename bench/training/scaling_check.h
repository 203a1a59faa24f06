// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "bench/training/scaling_model.h"
#include "trainer/collective/collective.h"

namespace earshot {

/// Updates as training makes them, with sleep in the place of computation, so that more workers than the machine has cores do not take it
/// from each other; sums and small calls are real.
struct ScalingCheckOptions {
  int updates = 40;
  int rollout_steps = 16;
  double step_s = 5e-3;  ///< mean; each step draws from between 0 and twice that
  double spread = 0.25;  ///< of a worker's rollout beside that, relative: its scene and sound, drawn for each rollout
  double learn_s = 0.04;
  int sums = 4;
  std::size_t bytes = 19'809'812;
  int exchanges = 8;  ///< small calls of an update: a status per minibatch, stop votes, counters
};

struct MeasuredUpdates {
  double update_s = 0;           ///< mean, of rank 0
  std::vector<double> rollouts;  ///< seconds, of all workers
  double learn_s = 0;            ///< mean of all workers
};

/// A collective call; the same on every worker.
MeasuredUpdates make_updates(const ScalingCheckOptions& options, Collective& workers);

/// Two workers: times of a small sum, and of two that go round the ring, by the wall and of the processor.
LinkSpeed measure_link(std::size_t bytes, Collective& workers);

/// Time of one worker alone.
UpdateWork work_of(const ScalingCheckOptions& options, const MeasuredUpdates& alone);

}  // namespace earshot
