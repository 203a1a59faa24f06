// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/guidance_config.h"

#include <algorithm>

#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// From `first` to `last` by the time that `until` of the training is over.
double falling(double first, double last, double until, double progress) {
  if (until <= 0) return last;
  return last + (first - last) * std::max(0.0, 1.0 - progress / until);
}

}  // namespace

double GuidanceConfig::imitation_at(double progress) const { return falling(imitation, imitation_end_weight, imitation_until, progress); }

double GuidanceConfig::oracle_at(double progress) const { return falling(oracle, 0, oracle_until, progress); }

void read(ConfigReader& reader, GuidanceConfig& config) {
  reader.read("imitation", config.imitation, Allowed::at_least(0),
              "Weight of the cross-entropy between the policy and the oracle's action (DAgger), at the start of the training.");
  reader.read("imitation_end_weight", config.imitation_end_weight, Allowed::at_least(0),
              "Weight of imitation from imitation_until on; it falls linearly to this.");
  reader.read("imitation_until", config.imitation_until, Allowed::between(0, 1),
              "Fraction of the training after which imitation has its end weight.");
  reader.read("oracle", config.oracle, Allowed::between(0, 1),
              "Fraction of the episodes in which the oracle acts, at the start; those steps teach by imitation only.");
  reader.read("oracle_until", config.oracle_until, Allowed::between(0, 1), "Fraction of the training after which the oracle acts no more.");
  reader.read("goal", config.goal, Allowed::at_least(0), "Weight of the loss of policy.goal_heads.");
}

void validate(const GuidanceConfig& config) {
  check_values(config, "guidance");
  require(config.imitation == 0 || config.imitation_until > 0, "guidance.imitation_until", config.imitation_until,
          "must be positive: otherwise guidance.imitation ends before it begins");
  require(config.oracle == 0 || config.imitation > 0, "guidance.oracle", config.oracle,
          "has no effect without guidance.imitation: the oracle's steps are used for imitation only");
  require(config.oracle == 0 || config.oracle_until > 0, "guidance.oracle_until", config.oracle_until,
          "must be positive: otherwise guidance.oracle ends before it begins");
  require(config.oracle == 0 || config.oracle_until <= config.imitation_until || config.imitation_end_weight > 0, "guidance.oracle_until",
          config.oracle_until, "must not exceed guidance.imitation_until: later steps of the oracle would not be imitated");
}

}  // namespace earshot
