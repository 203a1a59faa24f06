// SPDX-License-Identifier: Apache-2.0
#include "datasets/measured/normal_equations.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "sim/base/random.h"

namespace earshot {
namespace {

TEST(NormalEquations, FitALineAsItsClosedForm) {
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const RandomStream random(41, Purpose::test, 5, draw);
    NormalEquations normal(2);
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (std::uint32_t i = 0; i < 12; ++i) {
      const double at = 4 * static_cast<double>(random.uniform(2 * i)) - 1, value = 3 * static_cast<double>(random.uniform(2 * i + 1));
      // Residual of the model 0 + 0 x: value left over is -value.
      normal.add(std::array{1.0, at}, -value);
      n += 1, x += at, y += value, xx += at * at, xy += at * value;
    }
    const auto step = normal.step();
    ASSERT_TRUE(step);
    const double slope = (n * xy - x * y) / (n * xx - x * x);
    EXPECT_NEAR((*step)[1], slope, 1e-10);
    EXPECT_NEAR((*step)[0], (y - slope * x) / n, 1e-10);
    const auto variances = normal.variances();
    ASSERT_TRUE(variances);
    EXPECT_NEAR((*variances)[1], n / (n * xx - x * x), 1e-10);
    EXPECT_NEAR((*variances)[0], xx / (n * xx - x * x), 1e-10);
  }
}

TEST(NormalEquations, HaveNoStepWithoutData) {
  NormalEquations normal(2);
  EXPECT_FALSE(normal.step());
  normal.add(std::array{1.0, 2.0}, 1.0);
  EXPECT_FALSE(normal.variances());  // one residual for two unknowns
}

}  // namespace
}  // namespace earshot
