// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/fast_angles.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace earshot {
namespace {

TEST(FastAngles, UnitPhaseIsThatOfTheStandardLibrary) {
  double worst = 0;
  for (int i = -40000; i <= 40000; ++i) {
    const double angle = 0.003 * i * (i % 7 == 0 ? 8000.0 : 1.0);  // up to 960,000
    const FourPhases four = fast_unit_phase(FourNumbers{angle, -angle, 0.5 * angle, 0});
    for (std::size_t lane = 0; lane < 4; ++lane) {
      const double true_angle = std::array<double, 4>{angle, -angle, 0.5 * angle, 0}[lane];
      worst = std::max({worst, std::abs(four.cosine[lane] - std::cos(true_angle)), std::abs(four.sine[lane] - std::sin(true_angle))});
    }
    ASSERT_EQ(four.cosine[3], 1.0);
    ASSERT_EQ(four.sine[3], 0.0);
  }
  EXPECT_LT(worst, 1e-10);
}

TEST(FastAngles, ArcTangentIsThatOfTheStandardLibrary) {
  double worst = 0;
  for (int i = 0; i <= 300; ++i)
    for (int j = -300; j <= 300; ++j) {
      if (i == 0 && j == 0) continue;
      const double x = 0.01 * i * i, y = 0.003 * j * std::abs(j);
      worst = std::max(worst, std::abs(fast_atan2(y, x) - std::atan2(y, x)));
    }
  EXPECT_LT(worst, 3e-8);
  EXPECT_EQ(fast_atan2(0.0, 0.0), 0.0);
}

}  // namespace
}  // namespace earshot
