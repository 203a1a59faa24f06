// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/value_scale.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace earshot {
namespace {

constexpr double kRate = 0.1;
/// Returns that do not vary would make the unit 0.
constexpr double kMinDeviation = 1e-2;

}  // namespace

void follow_returns(const PolicyNetwork& policy, const torch::Tensor& returns, const torch::Tensor& valid, std::uint64_t update,
                    Collective& collective) {
  const torch::Tensor rows = returns.masked_select(valid.logical_and(torch::isfinite(returns))).to(torch::kFloat64);
  std::array<double, 3> sums{static_cast<double>(rows.numel()), rows.sum().item<double>(), rows.square().sum().item<double>()};
  collective.all_reduce_sum(std::span<double>(sums));
  if (sums[0] == 0) return;
  const double mean = policy->value_mean(), deviation = policy->value_deviation();
  const double rate = update == 0 ? 1.0 : kRate;
  const double new_mean = mean + rate * (sums[1] / sums[0] - mean);
  const double square = mean * mean + deviation * deviation;
  const double new_square = square + rate * (sums[2] / sums[0] - square);
  policy->set_value_scale(new_mean, std::max(kMinDeviation, std::sqrt(std::max(0.0, new_square - new_mean * new_mean))));
}

}  // namespace earshot
