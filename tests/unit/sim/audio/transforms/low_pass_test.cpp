// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/low_pass.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace earshot {
namespace {

// Butterworth of fourth order through the bilinear transform: 1 / sqrt(1 + (tan(w / 2) / tan(w_c / 2))^8).
TEST(LowPass, HasTheMagnitudeOfButterworth) {
  for (const double rate_hz : {8000.0, 16000.0, 44100.0, 96000.0})
    for (const double cutoff_hz : {20.0, 120.0, 1000.0, 3999.0}) {
      const LowPass low_pass(cutoff_hz, rate_hz);
      for (double f = 1; f < 0.499 * rate_hz; f *= 1.37) {
        const double ratio = std::tan(std::numbers::pi * f / rate_hz) / std::tan(std::numbers::pi * cutoff_hz / rate_hz);
        EXPECT_NEAR(std::abs(low_pass.response(f)), 1 / std::sqrt(1 + std::pow(ratio, 8)), 1e-9) << f << " of " << cutoff_hz;
      }
      EXPECT_NEAR(20 * std::log10(std::abs(low_pass.response(cutoff_hz))), -3.0103, 1e-4);
      EXPECT_NEAR(std::abs(low_pass.response(0)), 1, 1e-9);
    }
}

TEST(LowPass, FiltersAsItsResponseSaysAndRingsAsLongAsItSays) {
  const double rate_hz = 16000;
  const LowPass low_pass(120, rate_hz);
  std::vector<float> impulse(4096, 0.f);
  impulse[0] = 1;
  low_pass.filter(impulse);
  for (const double f : {0.0, 30.0, 120.0, 250.0, 1000.0}) {
    std::complex<double> sum;
    for (std::size_t n = 0; n < impulse.size(); ++n)
      sum += static_cast<double>(impulse[n]) * std::polar(1.0, -2 * std::numbers::pi * f * static_cast<double>(n) / rate_hz);
    EXPECT_LT(std::abs(sum - low_pass.response(f)), 1e-5) << f;
  }
  float peak = 0, after = 0;
  for (std::size_t n = 0; n < impulse.size(); ++n) {
    const float level = std::abs(impulse[n]);
    peak = std::max(peak, level);
    if (static_cast<double>(n) > low_pass.ring_samples()) after = std::max(after, level);
  }
  EXPECT_LT(after, 1e-3f * peak);
  EXPECT_LT(low_pass.ring_samples(), 0.04 * rate_hz);
}

}  // namespace
}  // namespace earshot
