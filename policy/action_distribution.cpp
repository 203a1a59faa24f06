// SPDX-License-Identifier: Apache-2.0
#include "policy/action_distribution.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

torch::Tensor rows_on_host(const torch::Tensor& logits) { return logits.detach().to(torch::kFloat64).contiguous(); }

bool all_finite(std::span<const double> row) {
  for (const double logit : row)
    if (!std::isfinite(logit)) return false;
  return true;
}

/// Smallest action whose cumulative probability exceeds u.  In float64 and in the order of the actions: the bits depend on this row alone.
std::int32_t inverse_cdf(std::span<const double> logits, double u) {
  double largest = logits[0];
  for (const double logit : logits) largest = std::max(largest, logit);
  double total = 0;
  for (const double logit : logits) total += std::exp(logit - largest);
  double cumulative = 0;
  std::int32_t last_possible = 0;
  for (std::size_t action = 0; action < logits.size(); ++action) {
    const double weight = std::exp(logits[action] - largest);
    cumulative += weight;
    if (weight > 0) last_possible = static_cast<std::int32_t>(action);
    if (u * total < cumulative) return static_cast<std::int32_t>(action);
  }
  return last_possible;  // u * total rounded up to the total
}

}  // namespace

torch::Tensor log_probabilities(const torch::Tensor& logits, const torch::Tensor& actions) {
  return logits.log_softmax(-1).gather(-1, actions.unsqueeze(-1)).squeeze(-1);
}

torch::Tensor entropy(const torch::Tensor& logits) {
  // An action masked by a logit of -inf has p log p = 0, but 0 * -inf is NaN: a large finite logarithm in its place gives the limit,
  // gradient included.
  const torch::Tensor log_p = logits.log_softmax(-1);
  return -(log_p.exp() * log_p.clamp_min(-1e9)).sum(-1);
}

void sample_actions(const torch::Tensor& logits, std::span<const ActingEnv> envs, std::uint64_t seed, std::span<std::int32_t> actions) {
  EARSHOT_EXPECT(logits.dim() == 2 && static_cast<std::size_t>(logits.size(0)) == envs.size() && envs.size() == actions.size());
  const torch::Tensor rows = rows_on_host(logits);
  const std::size_t num_actions = static_cast<std::size_t>(rows.size(1));
  for (std::size_t i = 0; i < envs.size(); ++i) {
    const std::span<const double> row(rows.data_ptr<double>() + i * num_actions, num_actions);
    if (!all_finite(row))
      throw RunError(fmt::format("policy: env {}, episode {}, step {}", envs[i].env, envs[i].episode, envs[i].step),
                     "the logits are not finite: the weights or the observation contain NaN or infinity");
    const RandomStream random(seed, Purpose::action, envs[i].env, envs[i].episode, envs[i].step);
    actions[i] = inverse_cdf(row, random.uniform(0));
  }
}

void greedy_actions(const torch::Tensor& logits, std::span<std::int32_t> actions) {
  EARSHOT_EXPECT(logits.dim() == 2 && static_cast<std::size_t>(logits.size(0)) == actions.size());
  const torch::Tensor rows = rows_on_host(logits);
  const std::size_t num_actions = static_cast<std::size_t>(rows.size(1));
  for (std::size_t i = 0; i < actions.size(); ++i) {
    const std::span<const double> row(rows.data_ptr<double>() + i * num_actions, num_actions);
    if (!all_finite(row)) throw RunError(fmt::format("policy: batch row {}", i), "the logits are not finite");
    actions[i] = static_cast<std::int32_t>(std::max_element(row.begin(), row.end()) - row.begin());  // the first of equals
  }
}

}  // namespace earshot
