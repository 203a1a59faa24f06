// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/advantage_normalization.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace earshot {

torch::Tensor normalize_advantages(const torch::Tensor& advantages, const torch::Tensor& valid, Collective& collective) {
  const torch::Tensor rows = advantages.masked_select(valid.logical_and(torch::isfinite(advantages)));
  std::array<double, 2> first{static_cast<double>(rows.numel()), rows.sum().item<double>()};
  collective.all_reduce_sum(std::span<double>(first));
  const double count = std::max(1.0, first[0]), mean = first[1] / count;
  std::array<double, 1> second{(rows - mean).square().sum().item<double>()};
  collective.all_reduce_sum(std::span<double>(second));
  const double deviation = std::sqrt(second[0] / count);
  constexpr double rounding = 1.0 / (1 << 24);  // of a float32, relative
  const torch::Tensor centred = advantages - mean;
  return deviation > rounding * std::abs(mean) ? centred / (deviation + 1e-7) : centred * 0.0;
}

}  // namespace earshot
