// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>
#include <span>

#include "envs/sensors/observation.h"
#include "policy/policy_network.h"

namespace earshot {

/// One rollout of T steps of B envs, time first.  Row t holds what the policy saw before action t.  Begin with begin(), then one push per
/// step, then finish(); a rollout may stop early, the rows past num_steps() are never read (docs/explanation/ppo.md, section 1.2: stale
/// rows corrupted the original).
///
/// Only finite values are stored: a row whose reward, value, log-probability or bootstrap is NaN or infinite gets a zero
/// there and valid = 0, which gae() and the losses know how to leave out, and is counted.
class RolloutBuffer {
 public:
  RolloutBuffer(const ObservationSpec& spec, int max_steps, int num_envs, int hidden_size);

  /// hidden [B, hidden_size] before the first step of this rollout.
  void begin(const torch::Tensor& hidden);
  /// Observation and action at step t; everything is copied.  actions [B] int64.  not_done [B]: 0 where this observation is the first
  /// of an episode.  guided [B] or undefined (none): 1 where the oracle chose the action, from which PPO learns nothing.
  void push(const ObservationTensors& observations, const torch::Tensor& not_done, const torch::Tensor& actions,
            const torch::Tensor& log_prob, const torch::Tensor& value, const torch::Tensor& guided = {});
  /// Outcome of the step.  final_value [B]: V(final observation) where truncated, else 0.  valid [B]: 0 for idle envs and for steps to
  /// exclude from training (quarantined, or acted on a sanitized observation).
  void push_outcome(std::span<const float> rewards, std::span<const std::uint8_t> terminated, std::span<const std::uint8_t> truncated,
                    const torch::Tensor& final_value, std::span<const std::uint8_t> valid);
  /// next_value [B]: V of the observation after the last row.
  void finish(const torch::Tensor& next_value);

  /// Envs [first, first + count) of this rollout, in the same memory: writes to them fill these columns.  Once all columns have
  /// num_steps rows, say so to columns_are_filled().
  [[nodiscard]] RolloutBuffer columns(int first, int count) const;
  void columns_are_filled(int num_steps) { steps_ = num_steps; }

  [[nodiscard]] int num_steps() const { return steps_; }
  [[nodiscard]] int num_envs() const { return num_envs_; }
  /// Rows left out because they were not finite, since construction; those of columns() are counted there.
  [[nodiscard]] std::uint64_t dropped_rows() const { return dropped_rows_; }

  ObservationTensors observations;                                                                         ///< [max_steps, B, ...]
  torch::Tensor hidden;                                                                                    ///< [B, hidden_size]
  torch::Tensor not_done, actions, log_prob, values, rewards, terminated, truncated, final_values, valid;  ///< [max_steps, B]
  torch::Tensor guided;                                                                                    ///< [max_steps, B], see push
  torch::Tensor next_value;                                                                                ///< [B]

 private:
  void drop(std::int64_t step, std::int64_t env);

  int steps_ = 0, num_envs_ = 0;
  std::uint64_t dropped_rows_ = 0;
};

}  // namespace earshot
