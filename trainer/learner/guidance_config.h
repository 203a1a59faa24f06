// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace earshot {

class ConfigReader;

/// Training signals from the simulator besides rewards.  All of it is off by default, and nothing of it is there when the agent is
/// evaluated: the oracle's actions and the way to the goal are labels (privileged sensors, envs/sensors/sensor.h).
struct GuidanceConfig {
  /// Weight of the cross-entropy between the policy and the oracle's action at every observation of the rollout (DAgger, Ross, Gordon and
  /// Bagnell 2011: states of the learner, labels of the expert), beside PPO's loss.  Falls linearly to imitation_end_weight at
  /// imitation_until, a fraction of the training.
  double imitation = 0, imitation_end_weight = 0, imitation_until = 0.5;
  /// Fraction of the episodes in which the oracle acts, falling linearly to 0 at oracle_until.  Those steps teach by imitation alone.
  double oracle = 0, oracle_until = 0.1;
  /// Weight of the loss of PolicyOutput::goal; with policy.goal_heads.
  double goal = 0;

  [[nodiscard]] double imitation_at(double progress) const;
  [[nodiscard]] double oracle_at(double progress) const;
};
void read(ConfigReader& reader, GuidanceConfig& config);
/// Throws InputError naming the key, its value and the rule.
void validate(const GuidanceConfig& config);

}  // namespace earshot
