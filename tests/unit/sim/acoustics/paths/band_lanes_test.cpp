// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/band_lanes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

namespace earshot {
namespace {

TEST(BandLanes, PhasesExponentialsAndArgumentsAreThoseOfTheLibrary) {
  for (float x = -100; x < 100; x += 0.137f) {
    const ComplexLanes phase = unit_phase(all_lanes(x));
    EXPECT_NEAR(phase.real[2], std::cos(double{x}), 3e-7) << x;
    EXPECT_NEAR(phase.imag[2], std::sin(double{x}), 3e-7) << x;
    const float below = x - 100.f;
    EXPECT_NEAR(exp_of_negative(all_lanes(below))[1] / std::exp(std::max(double{below}, -87.0)), 1.0, 3e-7) << x;
    const std::complex<double> z = std::polar(std::exp(0.3 * x), 0.01 * std::numbers::pi * x);
    const ComplexLanes lanes = {all_lanes(static_cast<float>(z.real())), all_lanes(static_cast<float>(z.imag()))};
    EXPECT_NEAR(argument(lanes)[7], std::arg(z), 3e-7) << x;
  }
  EXPECT_EQ(argument(ComplexLanes{})[0], 0.f);
  EXPECT_EQ(exp_of_negative(Lanes{})[0], 1.f);
}

TEST(BandLanes, PhasesOfLongWaysAreExact) {
  std::array<double, kLanes> wavenumbers;
  for (std::size_t i = 0; i < kLanes; ++i) wavenumbers[i] = 2 * std::numbers::pi * 62.5 * std::exp2(static_cast<double>(i)) / 343;
  const WaveLanes waves(wavenumbers);
  for (const double way_m : {0.0, 1e-4, 0.3, 17.1, 1234.5}) {
    const ComplexLanes turn = waves.turn(way_m);
    for (std::size_t i = 0; i < kLanes; ++i) {
      EXPECT_NEAR(turn.real[i], std::cos(wavenumbers[i] * way_m), 1e-6) << way_m;
      EXPECT_NEAR(turn.imag[i], std::sin(wavenumbers[i] * way_m), 1e-6) << way_m;
    }
  }
}

}  // namespace
}  // namespace earshot
