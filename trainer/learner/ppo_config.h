// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "trainer/learner/gae_config.h"

namespace earshot {

class ConfigReader;

/// Weight of a worker whose rollout ended early in the mean over workers (docs/explanation/ppo.md, section 5.3).
enum class PreemptWeight {
  sample,    ///< each sample the same
  worker,    ///< each worker the same
  truncated  ///< each sample by its importance weight, at most 1
};

struct PpoConfig {
  double clip = 0.2, value_coefficient = 0.5, entropy_coefficient = 0.05;
  double learning_rate = 2.5e-4, adam_epsilon = 1e-5, max_gradient_norm = 0.2;
  int epochs = 2, minibatches = 2;  ///< minibatches split the envs, sequences stay whole
  bool clip_value_loss = true, normalize_advantages = false;
  bool linear_learning_rate_decay = false, linear_clip_decay = false, linear_entropy_decay = false;
  /// Epochs end early once the mean of approx_kl over the minibatches of an epoch, of all workers, is over this; 0: never.
  double target_kl = 0;
  /// Once this fraction of the workers has its rollout, the others end theirs, after preempt_least of the steps at least (DD-PPO, Wijmans
  /// et al. 2020, section 3; preemption.h).  0: all are waited for.  When a worker is cut short depends on the clock, so that two runs do
  /// not have the same bits.
  double preempt_fraction = 0;
  double preempt_least = 0.25;
  PreemptWeight preempt_weight = PreemptWeight::sample;
  /// Above these a minibatch raises an alarm: it is counted and reported, the step is taken.  (Sample Factory's limits.)
  double loss_alarm = 30, kl_alarm = 100;
  /// How often in a row weights that have gone bad (weight_check.h) are put back to those of the last good update, and the run goes on with
  /// the next rollout.  0: the run ends with the last good checkpoint.
  int roll_backs = 0;
  GaeConfig gae;
};
void read(ConfigReader& reader, PpoConfig& config);
/// Throws InputError naming the key, its value and the rule.
void validate(const PpoConfig& config);

}  // namespace earshot
