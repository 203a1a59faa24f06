// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/nn/module.h>
#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <string>

#include "policy/observation_tensors.h"
#include "policy/policy_config.h"

namespace earshot {

inline constexpr int kGoalOutputs = 6;

struct PolicyOutput {
  torch::Tensor logits;  ///< [N, kNumActions] (or [T * B, kNumActions])
  torch::Tensor value;   ///< [N]
  torch::Tensor hidden;  ///< [B, hidden_size] after the last step
  /// [N, kGoalOutputs] with PolicyConfig::goal_heads, else undefined: what the agent makes of where the goal is.  Cosine and sine of its
  /// bearing, the same of the next corner on the way, log(1 + metres on foot), and the logit of being near enough to stop.
  torch::Tensor goal = {};
};

/// What acts and learns: the built-in network (actor_critic.h) or a module of the user's (module_policy.h).  Rollouts, learner, checkpoints
/// and evaluation know it by this interface alone; its parameters and buffers are those of the torch module, by name.
class PolicyNetworkImpl : public torch::nn::Module {
 public:
  explicit PolicyNetworkImpl(const PolicyConfig& config) : config_(config) {}

  /// One step of N envs.  hidden [N, hidden_size]; not_done [N] float, 0 where a new episode begins (the state begins anew there).
  PolicyOutput step(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done);
  /// T steps of B envs in time order: observations [T * B, ...] with T outermost; hidden [B, hidden_size] before the first step;
  /// not_done [T, B].  Equal to T calls of step to 1e-6 (a module's: 1e-4).
  virtual PolicyOutput sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) = 0;

  /// Numbers of the recurrent state of an env.
  [[nodiscard]] virtual int hidden_size() const = 0;
  /// One line that says which weights fit: sensors, shapes and sizes.  Checkpoints compare it.
  [[nodiscard]] virtual std::string architecture() const = 0;
  /// The TorchScript file that the network is, for checkpoints; null for the built-in network.
  [[nodiscard]] virtual std::shared_ptr<const std::string> module_file() const { return nullptr; }
  [[nodiscard]] std::int64_t num_parameters() const;

  /// With PolicyConfig::normalize_values: the critic's unit and origin become these, its values stay what they were (PopArt).
  virtual void set_value_scale(double mean, double deviation) = 0;
  [[nodiscard]] bool normalizes_values() const { return config_.normalize_values; }
  [[nodiscard]] double value_mean() const { return value_mean_.defined() ? value_mean_.item<double>() : 0; }
  [[nodiscard]] double value_deviation() const { return value_deviation_.defined() ? value_deviation_.item<double>() : 1; }

 protected:
  /// Registers the buffers of normalize_values, if it is on.
  void register_value_scale();
  /// In the unit of the returns.
  [[nodiscard]] torch::Tensor scaled_value(const torch::Tensor& value) const;
  /// Moves origin and unit, and a last linear layer of one output so that its values stay.
  void move_value_scale(double mean, double deviation, torch::Tensor weight, torch::Tensor bias);

  PolicyConfig config_;

 private:
  torch::Tensor value_mean_ = {}, value_deviation_ = {};  ///< [1], of normalize_values
};
using PolicyNetwork = std::shared_ptr<PolicyNetworkImpl>;

/// The network that `config` asks for: the built-in one, or that of the file PolicyConfig::module.  Throws InputError as their
/// constructors.
PolicyNetwork make_policy(const ObservationSpec& spec, const PolicyConfig& config);

}  // namespace earshot
