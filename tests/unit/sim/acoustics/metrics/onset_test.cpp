// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/onset.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr double kOnsetRateHz = 44100;

/// A response as one measures it: noise before and under it, the direct sound, a louder reflection and a decay of noise.
struct DrawnResponse {
  explicit DrawnResponse(std::uint32_t number) {
    const RandomStream random(38, Purpose::test, 2, number);
    const auto within = [&](std::uint32_t draw, double low, double high) {
      return low + (high - low) * static_cast<double>(random.uniform(draw));
    };
    onset = static_cast<std::size_t>(within(0, 100, 4000));
    const double direct = std::pow(10, within(1, -12, 0) / 20), floor = std::pow(10, within(2, -80, -32) / 20);
    const double t60_s = within(3, 0.2, 1.0), level = within(4, 0.02, 0.1);
    const auto begin = onset + static_cast<std::size_t>(0.004 * kOnsetRateHz);
    samples.resize(44100);
    for (std::size_t n = 0; n < samples.size(); ++n) {
      const auto normal = random.normal2(static_cast<std::uint32_t>(100 + n));
      samples[n] = static_cast<float>(floor * static_cast<double>(normal[0]));
      if (n < begin) continue;
      const double t = static_cast<double>(n - begin) / kOnsetRateHz;
      samples[n] += static_cast<float>(level * static_cast<double>(normal[1]) * std::exp(-3 * std::numbers::ln10 * t / t60_s));
    }
    samples[onset] += static_cast<float>(direct);
    samples[begin + 300] += 1.f;
    const auto window = static_cast<std::size_t>(std::lround(0.0025 * kOnsetRateHz));
    double direct_energy = 0, rest = 0;
    for (std::size_t n = 0; n < samples.size(); ++n) {
      const bool near_onset = n + window >= onset && n < onset + window;
      (near_onset ? direct_energy : rest) += double{samples[n]} * double{samples[n]};
    }
    drr_db = 10 * std::log10(direct_energy / rest);
  }
  std::vector<float> samples;
  std::size_t onset;
  double drr_db;
};

// The direct sound stands at most 12 dB below the strongest sample, and 20 dB or more above the noise: it is found to the sample.
TEST(Onset, IsTheDirectSoundAboveNoise) {
  for (std::uint32_t number = 0; number < 20; ++number) {
    const DrawnResponse drawn(number);
    ASSERT_TRUE(find_onset(drawn.samples, kOnsetRateHz).has_value());
    EXPECT_EQ(*find_onset(drawn.samples, kOnsetRateHz), drawn.onset) << number;
  }
}

// With time zero at the first sample instead the ratio is that of the noise before the direct sound, 30 dB and more below.
TEST(Onset, IsTimeZeroWhereNoneIsGiven) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const DrawnResponse drawn(number);
    const RoomMetrics found = measure(drawn.samples, static_cast<float>(kOnsetRateHz), RirMeasurement{});
    ASSERT_TRUE(found.drr_db && found.direct_delay_s);
    EXPECT_NEAR(*found.drr_db, drawn.drr_db, 0.01) << number;
    EXPECT_NEAR(*found.direct_delay_s, static_cast<double>(drawn.onset) / kOnsetRateHz, 1e-9);
    const RoomMetrics told = measure(drawn.samples, static_cast<float>(kOnsetRateHz), static_cast<double>(drawn.onset) / kOnsetRateHz);
    EXPECT_EQ(found.bands[3].c80_db, told.bands[3].c80_db);
    EXPECT_EQ(found.bands[3].edt_s, told.bands[3].edt_s);
  }
}

TEST(Onset, SilenceHasNoneAndNoiseHasOne) {
  EXPECT_FALSE(find_onset({}, 16000));
  EXPECT_FALSE(find_onset(std::vector<float>(1000, 0.f), 16000));
  std::vector<float> noise(16000);
  const RandomStream random(38, Purpose::test, 3);
  for (std::size_t n = 0; n < noise.size(); ++n) noise[n] = random.normal2(static_cast<std::uint32_t>(n))[0];
  EXPECT_TRUE(find_onset(noise, 16000));
  EXPECT_EQ(find_onset(std::vector<float>(1, -2.f), 16000), 0u);
  EXPECT_EQ(find_onset(std::vector<float>(5000, 0.3f), 16000), 0u);
  const RoomMetrics silent = measure(std::vector<float>(1000, 0.f), 16000.f, RirMeasurement{});
  EXPECT_FALSE(silent.drr_db || silent.direct_delay_s);
  EXPECT_THROW(measure(std::vector<float>{0.f, std::numeric_limits<float>::quiet_NaN()}, 16000.f, RirMeasurement{}), InputError);
}

// Two ears: parameters of channel 0 count from its own onset, the windows of IACC from the earlier one.
TEST(Onset, OfTwoEarsTheEarlierBegins) {
  Rir rir{.num_channels = 2, .num_samples = 8000, .sample_rate_hz = 16000.f, .samples = std::vector<float>(16000, 0.f)};
  rir.samples[1008] = 1.f, rir.samples[8000 + 1000] = 1.f;
  const RoomMetrics found = measure(rir, RirMeasurement{}), told = measure(rir, 1000.0 / 16000);
  EXPECT_NEAR(*found.direct_delay_s, 1008.0 / 16000, 1e-9);
  EXPECT_EQ(found.bands[4].iacc_early, told.bands[4].iacc_early);
}

}  // namespace
}  // namespace earshot
