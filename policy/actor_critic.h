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
#include "policy/policy_network.h"

namespace earshot {

/// Recurrent actor-critic: [vectors, audio CNN, visual CNN per camera] -> GRU -> categorical actor over four actions, scalar critic.  A
/// camera's depth, colours in [0, 1] and normals are channels of one picture.  Vectors are the sensors without a picture: the point goal,
/// the way since the start with cosine and sine of its angles, the collision, the last action as one of five.  Waveforms and categories
/// have no encoder: a policy refuses them.
/// Initial weights are a function of PolicyConfig::seed: convolutions and encoders Kaiming-normal for ReLU, GRU orthogonal for each of its
/// gates, actor orthogonal with gain 0.01 (all actions about equally likely at first), critic orthogonal with gain 1, biases 0.
/// Spectrogram and interaural cells are channels of one picture.  Privileged sensors are not read, but goal_state by a guided critic.
class ActorCriticImpl : public PolicyNetworkImpl {
 public:
  /// Throws InputError if no sensor is on, one has no encoder, or a picture is too small for the convolutions.
  ActorCriticImpl(const ObservationSpec& spec, const PolicyConfig& config);

  PolicyOutput sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done) override;
  [[nodiscard]] int hidden_size() const override { return config_.hidden_size; }
  void set_value_scale(double mean, double deviation) override;
  [[nodiscard]] std::string architecture() const override;

 private:
  torch::Tensor encode(const ObservationTensors& observations);  // -> [N, features]
  torch::Tensor values_of(const torch::Tensor& states, const torch::Tensor& goal_state);
  void initialize_weights();

  std::vector<SensorSpec> sensors_;
  std::vector<ConvEncoder> visual_;  ///< by camera
  ConvEncoder audio_{nullptr};
  MaskedGru rnn_{nullptr};
  torch::nn::Linear actor_{nullptr}, critic_{nullptr};
  torch::nn::Linear critic_hidden_{nullptr};  ///< of a guided critic
  torch::nn::Linear goal_{nullptr};           ///< of goal_heads
};

/// Holds an ActorCriticImpl, as TORCH_MODULE would declare it, and is a PolicyNetwork where one is needed.
class ActorCritic : public torch::nn::ModuleHolder<ActorCriticImpl> {
 public:
  using ModuleHolder<ActorCriticImpl>::ModuleHolder;
  operator PolicyNetwork() const { return ptr(); }  // NOLINT(google-explicit-constructor): as a pointer to a derived class
};

}  // namespace earshot
