#pragma once

#include <torch/nn/module.h>
#include <torch/nn/modules/linear.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "envs/action.h"
#include "envs/observation.h"
#include "policy/conv_encoder.h"
#include "policy/masked_gru.h"
#include "policy/observation_tensors.h"
#include "policy/policy_config.h"

namespace earshot {

struct PolicyOutput {
  torch::Tensor logits;  ///< [N, kNumActions] (or [T * B, kNumActions])
  torch::Tensor value;   ///< [N]
  torch::Tensor hidden;  ///< [B, hidden_size] after the last step
};

/// Recurrent actor-critic: [vectors, audio CNN, visual CNN per camera] -> GRU -> categorical actor over four actions, scalar critic.  A
/// camera's depth, colours in [0, 1] and normals are channels of one picture.  Vectors are the sensors without a picture: the point goal,
/// the way since the start with cosine and sine of its angles, the collision, the last action as one of five.  Waveforms and categories
/// have no encoder: a policy refuses them.
/// Initial weights are a function of PolicyConfig::seed: convolutions and encoders Kaiming-normal for ReLU, GRU orthogonal for each of its
/// gates, actor orthogonal with gain 0.01 (all actions about equally likely at first), critic orthogonal with gain 1, biases 0.
class ActorCriticImpl : public torch::nn::Module {
 public:
  /// Throws InputError if no sensor is on, one has no encoder, or a picture is too small for the convolutions.
  ActorCriticImpl(const ObservationSpec& spec, const PolicyConfig& config);

  /// One step of N envs.  hidden [N, hidden_size]; not_done [N] float, 0 where a new episode begins (hidden is zeroed there).
  PolicyOutput step(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done);
  /// T steps of B envs in time order: observations [T * B, ...] with T outermost; hidden [B, hidden_size] before the first step;
  /// not_done [T, B].  Equal to T calls of step to 1e-6.  Virtual, so that a test can put a fault into what the network says.
  virtual PolicyOutput sequence(const ObservationTensors& observations, const torch::Tensor& hidden, const torch::Tensor& not_done);

  [[nodiscard]] int hidden_size() const { return config_.hidden_size; }
  [[nodiscard]] std::int64_t num_parameters() const;
  /// One line that says which weights fit: sensors, shapes and sizes.  Checkpoints compare it.
  [[nodiscard]] std::string architecture() const;

 private:
  torch::Tensor encode(const ObservationTensors& observations);  // -> [N, features]
  void initialize_weights();

  std::vector<SensorSpec> sensors_;
  PolicyConfig config_;
  std::vector<ConvEncoder> visual_;  ///< by camera
  ConvEncoder audio_{nullptr};
  MaskedGru rnn_{nullptr};
  torch::nn::Linear actor_{nullptr}, critic_{nullptr};
};
TORCH_MODULE(ActorCritic);

}  // namespace earshot
