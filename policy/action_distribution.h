// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>
#include <torch/utils.h>

#include <cstdint>
#include <span>

namespace earshot {

/// Categorical distribution over the last axis of `logits`, as pure functions.
torch::Tensor log_probabilities(const torch::Tensor& logits, const torch::Tensor& actions);  ///< [N, A], [N] int64 -> [N]
torch::Tensor entropy(const torch::Tensor& logits);                                          ///< [N, A] -> [N]

/// Identity of an acting env: its random number is a function of these values, not of the batch.
struct ActingEnv {
  std::uint32_t env, episode, step;
};
/// Inverse-CDF sampling with the counter-based stream (seed, Purpose::action, env, episode, step).  Writes actions [N].
/// Throws RunError naming the env if its logits are not finite.
void sample_actions(const torch::Tensor& logits, std::span<const ActingEnv> envs, std::uint64_t seed, std::span<std::int32_t> actions);
/// Arg max, lowest index on ties.
void greedy_actions(const torch::Tensor& logits, std::span<std::int32_t> actions);

}  // namespace earshot
