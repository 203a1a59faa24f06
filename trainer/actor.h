#pragma once

#include <torch/torch.h>

#include <cstdint>
#include <vector>

#include "envs/batched_env.h"
#include "policy/action_distribution.h"
#include "policy/actor_critic.h"

namespace earshot {

/// Views of the env's observation rows as tensors, without a copy: valid until its next step or reset.
ObservationTensors observation_tensors(const BatchedEnv& env);
/// Views of the last observations of the episodes that just ended.
ObservationTensors final_observation_tensors(const BatchedEnv& env);

/// The recurrent policy acting in a batch of envs: hidden state and episode starts, kept between steps.
class Actor {
 public:
  Actor(ActorCritic policy, int num_envs);

  /// Runs the policy on the env's current observations: output().logits [B, 4], value [B].  The new hidden state waits for advance().
  const PolicyOutput& observe(const BatchedEnv& env);
  /// Values of the final observations, with the hidden state after the last step and before any reset; zero where not truncated. [B]
  torch::Tensor truncated_values(const BatchedEnv& env);
  /// Takes over the new hidden state and notes which envs began a new episode in the last env step.
  void advance(const BatchedEnv& env);
  /// Value of the current observation without moving on. [B]
  torch::Tensor peek_value(const BatchedEnv& env);

  [[nodiscard]] const torch::Tensor& hidden() const { return hidden_; }      ///< [B, H] before observe()
  [[nodiscard]] const torch::Tensor& not_done() const { return not_done_; }  ///< [B], 0 where the current observation begins an episode
  void restore(const torch::Tensor& hidden, const torch::Tensor& not_done);

 private:
  ActorCritic policy_;
  torch::Tensor hidden_, not_done_;
  PolicyOutput output_;
};

}  // namespace earshot
