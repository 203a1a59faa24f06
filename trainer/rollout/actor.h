// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>
#include <span>
#include <vector>

#include "envs/batch/batched_env.h"
#include "policy/action_distribution.h"
#include "policy/policy_network.h"

namespace earshot {

/// Views of the env's observation rows as tensors, without a copy: valid until its next step or reset.
ObservationTensors observation_tensors(const BatchedEnv& env);
/// Views of the last observations of the episodes that just ended.
ObservationTensors final_observation_tensors(const BatchedEnv& env);

/// The recurrent policy acting in a batch of envs: hidden state and episode starts, kept between steps.
///
/// One env's NaN must neither stay in its hidden state (0 * NaN is NaN: not even the next episode would be rid of it) nor reach the learner
/// through the sequence.  So every row is checked: an observation row that is not finite is zeroed, and a hidden state that is not finite
/// begins anew, as at the start of an episode.  Such rows are marked in sanitized() and counted.  Remaining non-finite values come from the
/// weights; sample_actions refuses them with the env's id.
class Actor {
 public:
  /// Of rows [first_row, first_row + num_rows) of a batch: the others are not read.
  Actor(PolicyNetwork policy, int first_row, int num_rows);

  /// Runs the policy on the env's current observations: output().logits [B, 4], value [B].  The new hidden state waits for advance().
  const PolicyOutput& observe(const BatchedEnv& env);
  /// The same for observations from elsewhere; they must live until advance().
  const PolicyOutput& observe(const ObservationTensors& observations);
  /// Observations that observe() passed to the policy: views of the env's rows, or copies where rows were sanitized.  Valid until the env's
  /// next step.
  [[nodiscard]] const ObservationTensors& seen() const { return seen_; }
  /// [num_rows] 1 where the last observe() sanitized the row: do not train on it.
  [[nodiscard]] std::span<const std::uint8_t> sanitized() const { return sanitized_; }
  /// Since construction.
  [[nodiscard]] std::uint64_t sanitized_rows() const { return sanitized_rows_; }
  /// Values of the final observations, with the hidden state after the last step and before any reset; zero where not truncated, NaN where
  /// the observation is not finite. [B]
  torch::Tensor truncated_values(const BatchedEnv& env);
  /// Takes over the new hidden state and notes which envs began a new episode in the last env step.
  void advance(const BatchedEnv& env);
  /// Value of the current observation without moving on; NaN where the observation is not finite. [B]
  torch::Tensor peek_value(const BatchedEnv& env);

  [[nodiscard]] const torch::Tensor& hidden() const { return hidden_; }  ///< [B, H] before observe()
  [[nodiscard]] const torch::Tensor& not_done() const {
    return not_done_;
  }  ///< [B], 0 where the current observation begins an episode, or a sanitized hidden state
  void restore(const torch::Tensor& hidden, const torch::Tensor& not_done);

 private:
  PolicyNetwork policy_;
  int first_row_, num_rows_;
  torch::Tensor hidden_, not_done_;
  ObservationTensors seen_;
  PolicyOutput output_;
  std::vector<std::uint8_t> sanitized_;
  std::uint64_t sanitized_rows_ = 0;
};

}  // namespace earshot
