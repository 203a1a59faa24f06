// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/gae.h"

#include "sim/base/errors.h"

namespace earshot {

torch::Tensor gae(const torch::Tensor& rewards, const torch::Tensor& values, const torch::Tensor& terminated,
                  const torch::Tensor& truncated, const torch::Tensor& final_values, const torch::Tensor& next_value,
                  const GaeConfig& config, const torch::Tensor& valid) {
  EARSHOT_EXPECT(rewards.dim() == 2 && values.sizes() == rewards.sizes() && terminated.sizes() == rewards.sizes());
  EARSHOT_EXPECT(truncated.sizes() == rewards.sizes() && final_values.sizes() == rewards.sizes() && next_value.numel() == rewards.size(1));
  EARSHOT_EXPECT(!valid.defined() || valid.sizes() == rewards.sizes());
  const torch::NoGradGuard no_gradient;
  const std::int64_t T = rewards.size(0);
  const torch::Tensor r = rewards.to(torch::kFloat64), v = values.to(torch::kFloat64);             // [T, B]
  const torch::Tensor by_end = terminated.to(torch::kBool), by_time = truncated.to(torch::kBool);  // [T, B]
  const torch::Tensor unknown = valid.defined() ? valid.to(torch::kBool).logical_not() : torch::zeros_like(by_end);
  const torch::Tensor cut = by_end | by_time | unknown;
  const torch::Tensor last = next_value.to(torch::kFloat64).view({1, -1});
  const torch::Tensor following = T > 1 ? torch::cat({v.slice(0, 1), last}) : last;  // [T, B] V(s_{t+1})

  // Chosen by `where`, not multiplied by 0 and 1: the other values may be NaN.
  torch::Tensor bootstrap = torch::where(by_time, final_values.to(torch::kFloat64), following);
  bootstrap = torch::where(by_end, torch::zeros_like(v), bootstrap);
  const torch::Tensor deltas = torch::where(unknown, torch::zeros_like(v), r + config.gamma * bootstrap - v);

  torch::Tensor advantages = torch::empty_like(deltas);
  torch::Tensor later = torch::zeros_like(deltas[0]);  // [B] A_{t+1}
  for (std::int64_t t = T - 1; t >= 0; --t) {
    later = deltas[t] + config.gamma * config.lambda * torch::where(cut[t], torch::zeros_like(later), later);
    advantages[t].copy_(later);
  }
  return advantages.to(rewards.scalar_type());
}

}  // namespace earshot
