// SPDX-License-Identifier: Apache-2.0
#include "policy/weight_init.h"

#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

torch::Tensor standard_normal(torch::IntArrayRef sizes, std::uint64_t seed, std::uint32_t index) {
  torch::Tensor tensor = torch::empty(sizes, torch::kFloat64);
  const RandomStream random(seed, Purpose::weights, index);
  double* values = tensor.data_ptr<double>();
  const std::int64_t count = tensor.numel();
  for (std::int64_t i = 0; i < count; i += 2) {
    const auto pair = random.normal2(static_cast<std::uint32_t>(i / 2));
    values[i] = pair[0];
    if (i + 1 < count) values[i + 1] = pair[1];
  }
  return tensor;
}

}  // namespace

void fill_kaiming_normal(torch::Tensor weight, std::uint64_t seed, std::uint32_t index) {
  const torch::NoGradGuard no_gradient;
  const double fan_in = static_cast<double>(weight.numel()) / static_cast<double>(weight.size(0));
  weight.copy_(standard_normal(weight.sizes(), seed, index) * std::sqrt(2.0 / fan_in));
}

void fill_orthogonal(torch::Tensor weight, double gain, std::uint64_t seed, std::uint32_t index) {
  EARSHOT_EXPECT(weight.dim() == 2);
  const torch::NoGradGuard no_gradient;
  const bool wide = weight.size(0) < weight.size(1);
  const torch::Tensor normal = standard_normal(weight.sizes(), seed, index);
  const auto [q, r] = torch::linalg_qr(wide ? normal.t() : normal);  // of the tall one
  const torch::Tensor orthogonal = q * r.diagonal().sign();
  weight.copy_(gain * (wide ? orthogonal.t() : orthogonal));
}

}  // namespace earshot
