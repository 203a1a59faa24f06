// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/interaural_bands.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "sim/acoustics/metrics/interaural.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr float kRate = 16000;

/// Noise from `seed` between 20 and 60 ms, in a response of 200 ms.
std::vector<float> burst(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::vector<float> samples(3200, 0.f);
  for (std::size_t i = 320; i < 960; ++i) samples[i] = normal(random);
  return samples;
}

std::vector<float> delayed(const std::vector<float>& samples, std::size_t by, float gain) {
  std::vector<float> result(samples.size(), 0.f);
  for (std::size_t i = by; i < samples.size(); ++i) result[i] = gain * samples[i - by];
  return result;
}

// Eight samples are 500 us; half the pressure is 6.02 dB.  A pair that differs by delay and gain alone has a correlation of 1.
TEST(InterauralBands, ADelayedPairHasItsDelayItsLevelAndFullCorrelation) {
  const std::vector<float> left = burst(1), right = delayed(left, 8, 0.5f);
  const auto bands = interaural_bands(left, right, kRate, 0.02);
  ASSERT_EQ(bands.size(), 7u);
  for (std::size_t b = 0; b < bands.size(); ++b) {
    EXPECT_NEAR(bands[b].ild_db.value(), 20 * std::log10(2.0), 0.01) << b;
    // A parabola through points an eighth of a period apart leaves half a per cent of the top of a cosine.
    EXPECT_GT(bands[b].iacc.value(), 0.99) << b;
    ASSERT_EQ(bands[b].itd_s.has_value(), b < 4) << b;
    if (b < 4) {
      EXPECT_NEAR(1e6 * *bands[b].itd_s, 500, 5) << b;
    }
  }
  const auto swapped = interaural_bands(right, left, kRate, 0.02);
  EXPECT_NEAR(1e6 * swapped[3].itd_s.value(), -500, 5);
  EXPECT_NEAR(swapped[3].ild_db.value(), -20 * std::log10(2.0), 0.01);
}

// What arrives after 80 ms moves no ITD: a far louder burst with the opposite delay follows at 150 ms.
TEST(InterauralBands, TheDelayIsThatOfTheFirstEightyMilliseconds) {
  std::vector<float> left = burst(1), right = delayed(left, 4, 1.f);
  const std::vector<float> late = delayed(burst(2), 2080, 10.f);
  for (std::size_t i = 0; i < left.size(); ++i) left[i] += late[i];
  const std::vector<float> later = delayed(late, 0, 1.f);
  for (std::size_t i = 4; i < right.size(); ++i) right[i - 4] += later[i];
  const auto bands = interaural_bands(left, right, kRate, 0.02);
  EXPECT_NEAR(1e6 * bands[3].itd_s.value(), 250, 5);
}

// The same coefficient as interaural_correlation, found another way.
TEST(InterauralBands, CorrelationIsThatOfIso3382) {
  std::vector<float> left = burst(1), right = delayed(burst(2), 5, 0.7f);
  for (std::size_t i = 0; i < left.size(); ++i) right[i] += 0.5f * left[i];
  const auto bands = interaural_bands(left, right, kRate, 0.02);
  for (int b = 1; b < 7; ++b)
    EXPECT_NEAR(bands[static_cast<std::size_t>(b)].iacc.value(), interaural_correlation(left, right, kRate, 0.02, b).total.value(), 0.02)
        << b;
}

TEST(InterauralBands, ASilentEarHasNoValues) {
  const std::vector<float> left = burst(1), right(left.size(), 0.f);
  for (const InterauralBand& band : interaural_bands(left, right, kRate, 0.02)) {
    EXPECT_FALSE(band.ild_db.has_value());
    EXPECT_FALSE(band.iacc.has_value());
    EXPECT_FALSE(band.itd_s.has_value());
  }
  EXPECT_THROW(interaural_bands(left, std::vector<float>(3), kRate, 0), InputError);
}

}  // namespace
}  // namespace earshot
