// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/harmonic_rotation.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "sim/audio/head/ambisonics.h"
#include "sim/base/errors.h"

namespace earshot {

HarmonicRotation::HarmonicRotation(int order) : order_(order) {
  require(order >= 0 && order <= kMaxAmbisonicOrder, "ambisonic order", order, fmt::format("must be in [0, {}]", kMaxAmbisonicOrder));
  matrix_.resize(index(order + 1, -order - 1, -order - 1));
  block_.resize(static_cast<std::size_t>(2 * order + 1) * kBlock);
  set(ListenerOrientation());
}

/// P of Ivanic and Ruedenberg: order 1 times order l - 1.
double HarmonicRotation::product(int i, int l, int a, int b) const {
  if (b == l) return at(1, i, 1) * at(l - 1, a, l - 1) - at(1, i, -1) * at(l - 1, a, 1 - l);
  if (b == -l) return at(1, i, 1) * at(l - 1, a, 1 - l) + at(1, i, -1) * at(l - 1, a, l - 1);
  return at(1, i, 0) * at(l - 1, a, b);
}

void HarmonicRotation::set(const ListenerOrientation& orientation) {
  matrix_[0] = 1;
  if (order_ == 0) return;
  // Order 1 in ACN order is (y, z, x) of the ambisonic axes, which is (-right, up, front) in the axes of Earshot: (-x, y, -z).
  const glm::dquat world_to_local = glm::conjugate(orientation.local_to_world());
  const std::array<glm::dvec3, 3> axis = {glm::dvec3(-1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, -1)};
  for (int n = -1; n <= 1; ++n) {
    const glm::dvec3 seen = world_to_local * axis[static_cast<std::size_t>(n + 1)];
    matrix_[index(1, -1, n)] = -seen.x;
    matrix_[index(1, 0, n)] = seen.y;
    matrix_[index(1, 1, n)] = -seen.z;
  }
  for (int l = 2; l <= order_; ++l) {
    for (int m = -l; m <= l; ++m) {
      for (int n = -l; n <= l; ++n) {
        const int size = std::abs(m);
        const double under = std::abs(n) == l ? 2.0 * l * (2.0 * l - 1.0) : static_cast<double>((l + n) * (l - n));
        const double zonal = m == 0 ? 1.0 : 0.0;
        const double u = std::sqrt((l + m) * (l - m) / under);
        const double v = 0.5 * std::sqrt((1.0 + zonal) * (l + size - 1) * (l + size) / under) * (1.0 - 2.0 * zonal);
        const double w = -0.5 * std::sqrt((l - size - 1.0) * (l - size) / under) * (1.0 - zonal);
        double sum = 0;
        // A factor of zero goes with indices out of range.
        if (u != 0) sum += u * product(0, l, m, n);
        if (m == 0) {
          sum += v * (product(1, l, 1, n) + product(-1, l, -1, n));
        } else if (m > 0) {
          const bool is_unit_order = m == 1;
          sum += v * (product(1, l, m - 1, n) * (is_unit_order ? std::sqrt(2.0) : 1.0) - (is_unit_order ? 0.0 : product(-1, l, 1 - m, n)));
          if (w != 0) sum += w * (product(1, l, m + 1, n) + product(-1, l, -m - 1, n));
        } else {
          const bool is_unit_order = m == -1;
          sum += v * ((is_unit_order ? 0.0 : product(1, l, m + 1, n)) + product(-1, l, -m - 1, n) * (is_unit_order ? std::sqrt(2.0) : 1.0));
          if (w != 0) sum += w * (product(1, l, m - 1, n) - product(-1, l, 1 - m, n));
        }
        matrix_[index(l, m, n)] = sum;
      }
    }
  }
}

void HarmonicRotation::apply(std::span<float> coefficients) const {
  EARSHOT_EXPECT(coefficients.size() >= static_cast<std::size_t>((order_ + 1) * (order_ + 1)));
  std::array<double, 2 * kMaxAmbisonicOrder + 1> turned{};
  for (int l = 1; l <= order_; ++l) {
    float* of_order = coefficients.data() + l * l;
    for (int m = -l; m <= l; ++m) {
      double sum = 0;
      for (int n = -l; n <= l; ++n) sum += at(l, m, n) * static_cast<double>(of_order[l + n]);
      turned[static_cast<std::size_t>(l + m)] = sum;
    }
    for (int i = 0; i <= 2 * l; ++i) of_order[i] = static_cast<float>(turned[static_cast<std::size_t>(i)]);
  }
}

void HarmonicRotation::apply(std::span<const std::span<float>> channels, std::size_t num_samples) {
  EARSHOT_EXPECT(channels.size() >= static_cast<std::size_t>((order_ + 1) * (order_ + 1)));
  for (int l = 1; l <= order_; ++l) {
    const auto width = static_cast<std::size_t>(2 * l + 1);
    const auto of_order = channels.subspan(static_cast<std::size_t>(l * l), width);
    for (std::size_t begin = 0; begin < num_samples; begin += kBlock) {
      const std::size_t count = std::min(kBlock, num_samples - begin);
      std::fill_n(block_.begin(), width * kBlock, 0.f);
      for (std::size_t m = 0; m < width; ++m) {
        float* out = block_.data() + m * kBlock;
        for (std::size_t n = 0; n < width; ++n) {
          const auto factor = static_cast<float>(at(l, static_cast<int>(m) - l, static_cast<int>(n) - l));
          const float* in = of_order[n].data() + begin;
          for (std::size_t i = 0; i < count; ++i) out[i] += factor * in[i];
        }
      }
      for (std::size_t m = 0; m < width; ++m)
        std::copy_n(block_.begin() + static_cast<std::ptrdiff_t>(m * kBlock), count,
                    of_order[m].begin() + static_cast<std::ptrdiff_t>(begin));
    }
  }
}

}  // namespace earshot
