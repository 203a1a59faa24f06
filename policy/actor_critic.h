// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/nn/module.h>
#include <torch/nn/modules/linear.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "envs/sensors/observation.h"
#include "envs/task/action.h"
#include "policy/conv_encoder.h"
#include "policy/masked_gru.h"
#include "policy/observation_tensors.h"
#include "policy/policy_config.h"

namespace earshot {

inline constexpr int kGoalOutputs = 6;

struct PolicyOutput {
  torch::Tensor logits;  ///< [N, kNumActions] (or [T * B, kNumActions])
  torch::Tensor value;   ///< [N]
  torch::Tensor hidden;  ///< [B, hidden_size] after the last step
  /// [N, kGoalOutputs] with PolicyConfig::goal_heads, else undefined: the agent's estimate of the position of the goal.  Cosine and sine of
  /// its
  /// bearing, the same of the next corner on the way, log(1 + metres on foot), and the logit of being near enough to stop.
  torch::Tensor goal = {};
};

/// Recurrent actor-critic: [vectors, audio CNN, visual CNN per camera] -> GRU -> categorical actor over four actions, scalar critic.  A
/// camera's depth, colours in [0, 1] and normals are channels of one picture.  Vectors are the sensors without a picture: the point goal,
/// the way since the start with cosine and sine of its angles, the collision, the last action as one of five.  Waveforms and categories
/// have no encoder: a policy refuses them.
/// Initial weights are a function of PolicyConfig::seed: convolutions and encoders Kaiming-normal for ReLU, GRU orthogonal for each of its
/// gates, actor orthogonal with gain 0.01 (all actions about equally likely at first), critic orthogonal with gain 1, biases 0.
/// Spectrogram and interaural cells are channels of one picture.  Privileged sensors are not read, but goal_state by a guided critic.
class ActorCriticImpl : public torch::nn::Module {
 public:
  /// Throws InputError if no sensor is on, one has no encoder, or a picture is too small for the convolutions.
  ActorCriticImpl(const ObservationSpec& spec, const PolicyConfig& config);

  /// One step of N envs.  hidden [N, hidden_size]; not_done [N] float, 0 where a new episode begins (hidden is zeroed there).
  PolicyOutput step(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done);
  /// T steps of B envs in time order: observations [T * B, ...] with T outermost; hidden [B, hidden_size] before the first step;
  /// not_done [T, B].  Equal to T calls of step to 1e-6.  Virtual, so that a test can inject a fault into the outputs of the network.
  virtual PolicyOutput sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done);

  [[nodiscard]] int hidden_size() const { return config_.hidden_size; }
  [[nodiscard]] std::int64_t num_parameters() const;
  /// With PolicyConfig::normalize_values: the critic's unit and origin become these, its values stay what they were (PopArt).
  void set_value_scale(double mean, double deviation);
  [[nodiscard]] bool normalizes_values() const { return config_.normalize_values; }
  [[nodiscard]] double value_mean() const { return value_mean_.defined() ? value_mean_.item<double>() : 0; }
  [[nodiscard]] double value_deviation() const { return value_deviation_.defined() ? value_deviation_.item<double>() : 1; }
  /// One line that says which weights fit: sensors, shapes and sizes.  Checkpoints compare it.
  [[nodiscard]] std::string architecture() const;

 private:
  torch::Tensor encode(const ObservationTensors& observations);  // -> [N, features]
  torch::Tensor values_of(const torch::Tensor& states, const torch::Tensor& goal_state);
  void initialize_weights();

  std::vector<SensorSpec> sensors_;
  PolicyConfig config_;
  std::vector<ConvEncoder> visual_;  ///< by camera
  ConvEncoder audio_{nullptr};
  MaskedGru rnn_{nullptr};
  torch::nn::Linear actor_{nullptr}, critic_{nullptr};
  torch::nn::Linear critic_hidden_{nullptr};              ///< of a guided critic
  torch::nn::Linear goal_{nullptr};                       ///< of goal_heads
  torch::Tensor value_mean_ = {}, value_deviation_ = {};  ///< [1], of normalize_values
};
TORCH_MODULE(ActorCritic);

}  // namespace earshot
