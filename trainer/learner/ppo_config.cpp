#include "trainer/learner/ppo_config.h"

#include <cmath>

#include "sim/base/text/config_reader.h"

namespace earshot {

void read(ConfigReader& reader, PpoConfig& config) {
  reader.read("clip", config.clip);
  reader.read("value_coefficient", config.value_coefficient);
  reader.read("entropy_coefficient", config.entropy_coefficient);
  reader.read("learning_rate", config.learning_rate);
  reader.read("adam_epsilon", config.adam_epsilon);
  reader.read("max_gradient_norm", config.max_gradient_norm);
  reader.read("epochs", config.epochs);
  reader.read("minibatches", config.minibatches);
  reader.read("clip_value_loss", config.clip_value_loss);
  reader.read("normalize_advantages", config.normalize_advantages);
  reader.read("linear_learning_rate_decay", config.linear_learning_rate_decay);
  reader.read("linear_clip_decay", config.linear_clip_decay);
  reader.read("linear_entropy_decay", config.linear_entropy_decay);
  reader.read("target_kl", config.target_kl);
  reader.read("preempt_fraction", config.preempt_fraction);
  reader.read("preempt_least", config.preempt_least);
  reader.read_choice<PreemptWeight>(
      "preempt_weight", config.preempt_weight,
      {{"sample", PreemptWeight::sample}, {"worker", PreemptWeight::worker}, {"truncated", PreemptWeight::truncated}});
  reader.read("loss_alarm", config.loss_alarm);
  reader.read("kl_alarm", config.kl_alarm);
  reader.read("roll_backs", config.roll_backs);
  reader.read("gamma", config.gae.gamma);
  reader.read("lambda", config.gae.lambda);
}

void validate(const PpoConfig& config) {
  const auto positive = [](const char* key, double value, const char* why) { require(value > 0 && std::isfinite(value), key, value, why); };
  const auto not_negative = [](const char* key, double value, const char* why) {
    require(value >= 0 && std::isfinite(value), key, value, why);
  };
  require(config.clip > 0 && config.clip < 1, "ppo.clip", config.clip,
          "must be between 0 and 1: the probability ratio stays in 1 - clip ... 1 + clip");
  not_negative("ppo.value_coefficient", config.value_coefficient, "must not be negative: it is the weight of the value loss");
  not_negative("ppo.entropy_coefficient", config.entropy_coefficient, "must not be negative: it rewards exploration");
  positive("ppo.learning_rate", config.learning_rate, "must be positive: it is the step of Adam");
  positive("ppo.adam_epsilon", config.adam_epsilon, "must be positive: it keeps Adam from dividing by zero");
  require(config.max_gradient_norm > 0 && config.max_gradient_norm <= 1e9, "ppo.max_gradient_norm", config.max_gradient_norm,
          "must be in (0, 1e9]: longer gradients are scaled down to it, and Adam keeps its square in a float");
  positive("ppo.loss_alarm", config.loss_alarm, "must be positive: a larger loss is reported");
  positive("ppo.kl_alarm", config.kl_alarm, "must be positive: a larger KL divergence from the rollout policy is reported");
  require(config.roll_backs >= 0, "ppo.roll_backs", config.roll_backs, "must not be negative: how often in a row bad weights are put back");
  not_negative("ppo.target_kl", config.target_kl, "must not be negative: epochs stop above this KL divergence; 0: no limit");
  require(config.preempt_fraction >= 0 && config.preempt_fraction < 1, "ppo.preempt_fraction", config.preempt_fraction,
          "must be in [0, 1): the fraction of slow workers that the others do not wait for; 0: wait for all");
  require(config.preempt_least >= 0 && config.preempt_least <= 1, "ppo.preempt_least", config.preempt_least,
          "must be in [0, 1]: the fraction of its rollout steps that every worker completes");
  require(config.preempt_fraction > 0 || config.preempt_least == PpoConfig{}.preempt_least, "ppo.preempt_least", config.preempt_least,
          "has no effect without ppo.preempt_fraction: all workers complete all of their steps");
  require(config.preempt_fraction > 0 || config.preempt_weight == PreemptWeight::sample, "ppo.preempt_weight",
          config.preempt_weight == PreemptWeight::worker ? "worker" : "truncated",
          "has no effect without ppo.preempt_fraction: all rollouts have the same length");
  require(config.epochs > 0, "ppo.epochs", config.epochs, "must be positive: number of passes over each rollout");
  require(config.minibatches > 0, "ppo.minibatches", config.minibatches,
          "must be positive: the environments of a worker are divided among them");
  require(config.gae.gamma >= 0 && config.gae.gamma <= 1, "ppo.gamma", config.gae.gamma,
          "must be in [0, 1]: it discounts rewards per step");
  require(config.gae.lambda >= 0 && config.gae.lambda <= 1, "ppo.lambda", config.gae.lambda,
          "must be in [0, 1]: it discounts advantages per step");
}

}  // namespace earshot
