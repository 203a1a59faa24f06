// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/ppo_config.h"

#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, PpoConfig& config) {
  reader.read("clip", config.clip, Allowed::above(0).below(1), "Bound of the probability ratio, which stays in 1 - clip to 1 + clip.");
  reader.read("value_coefficient", config.value_coefficient, Allowed::at_least(0), "Weight of the value loss.");
  reader.read("entropy_coefficient", config.entropy_coefficient, Allowed::at_least(0), "Weight of the entropy, which rewards exploration.");
  reader.read("learning_rate", config.learning_rate, Allowed::above(0), "Step size of Adam.");
  reader.read("adam_epsilon", config.adam_epsilon, Allowed::above(0).because("it keeps Adam from dividing by zero"),
              "Constant in the denominator of Adam.");
  reader.read("max_gradient_norm", config.max_gradient_norm, Allowed::above(0).up_to(1e9).because("Adam keeps its square in a float"),
              "Norm to which longer gradients are scaled down.");
  reader.read("epochs", config.epochs, Allowed::at_least(1), "Passes over each rollout.");
  reader.read("minibatches", config.minibatches, Allowed::at_least(1),
              "Minibatches of an epoch; they divide the environments of a worker, sequences stay whole.");
  reader.read("clip_value_loss", config.clip_value_loss, "Clips the change of the value in the value loss, as the ratio.");
  reader.read("normalize_advantages", config.normalize_advantages, "Normalizes advantages to mean 0 and deviation 1 over all workers.");
  reader.read("linear_learning_rate_decay", config.linear_learning_rate_decay, "Learning rate falls linearly to 0 over the training.");
  reader.read("linear_clip_decay", config.linear_clip_decay, "Clip falls linearly to 0 over the training.");
  reader.read("linear_entropy_decay", config.linear_entropy_decay, "Entropy coefficient falls linearly to 0 over the training.");
  reader.read("target_kl", config.target_kl, Allowed::at_least(0),
              "Approximate KL divergence above which no further epoch begins. 0: all epochs run.");
  reader.read("preempt_fraction", config.preempt_fraction, Allowed::at_least(0).below(1),
              "Fraction of the workers whose rollouts are complete before the others cut theirs short (DD-PPO). 0: all are waited for.");
  reader.read("preempt_least", config.preempt_least, Allowed::between(0, 1),
              "Fraction of its steps that a worker makes before it may be cut short.");
  reader.read_choice<PreemptWeight>(
      "preempt_weight", config.preempt_weight,
      {{"sample", PreemptWeight::sample}, {"worker", PreemptWeight::worker}, {"truncated", PreemptWeight::truncated}},
      "Weight of rollouts that were cut short. sample: each sample the same. worker: each worker the same. truncated: each sample by "
      "its "
      "importance weight, at most 1.");
  reader.read("loss_alarm", config.loss_alarm, Allowed::above(0), "Loss above which a minibatch is reported.");
  reader.read("kl_alarm", config.kl_alarm, Allowed::above(0), "Divergence from the acting policy above which a minibatch is reported.");
  reader.read("roll_backs", config.roll_backs, Allowed::at_least(0),
              "How often in a row bad weights are replaced by the last good ones. 0: the run ends.");
  reader.read("gamma", config.gae.gamma, Allowed::between(0, 1), "Discount of rewards per step.");
  reader.read("lambda", config.gae.lambda, Allowed::between(0, 1), "Discount of advantages per step (GAE).");
}

void validate(const PpoConfig& config) {
  check_values(config, "ppo");
  require(config.preempt_fraction > 0 || config.preempt_least == PpoConfig{}.preempt_least, "ppo.preempt_least", config.preempt_least,
          "has no effect without ppo.preempt_fraction: all workers complete all of their steps");
  require(config.preempt_fraction > 0 || config.preempt_weight == PreemptWeight::sample, "ppo.preempt_weight",
          config.preempt_weight == PreemptWeight::worker ? "worker" : "truncated",
          "has no effect without ppo.preempt_fraction: all rollouts have the same length");
}

}  // namespace earshot
