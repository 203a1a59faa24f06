#include "sim/acoustics/paths/fast_angles.h"

#include <gtest/gtest.h>

#include <cmath>

namespace earshot {
namespace {

TEST(FastAngles, UnitPhaseIsThatOfTheStandardLibrary) {
  double worst = 0;
  for (int i = -40000; i <= 40000; ++i) {
    const double angle = 0.003 * i * (i % 7 == 0 ? 8000.0 : 1.0);  // up to 960,000
    const std::complex<double> exact(std::cos(angle), std::sin(angle));
    worst = std::max(worst, std::abs(fast_unit_phase(angle) - exact));
  }
  EXPECT_LT(worst, 1e-10);
  EXPECT_EQ(fast_unit_phase(0.0), std::complex<double>(1.0, 0.0));
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
