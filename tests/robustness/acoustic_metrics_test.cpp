// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/base/errors.h"
#include "tests/support/acoustics/acoustic_engines.h"

/// Decay times where there is little or nothing to fit: the value is missing and the reason is given.
namespace earshot {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinity = std::numeric_limits<double>::infinity();

std::vector<double> decay(double t60_s, double bin_s, double length_s, double scale = 1) {
  std::vector<double> energy(static_cast<std::size_t>(std::lround(length_s / bin_s)));
  const double k = 6 * std::numbers::ln10 / t60_s;
  for (std::size_t i = 0; i < energy.size(); ++i)
    energy[i] = scale * (std::exp(-k * static_cast<double>(i) * bin_s) - std::exp(-k * static_cast<double>(i + 1) * bin_s));
  return energy;
}

void expect_none(const BandMetrics& band, DecayStatus why) {
  EXPECT_FALSE(band.rt60_s || band.t20_s || band.t30_s);
  EXPECT_EQ(band.decay, why) << name_of(band.decay);
}

TEST(H75_DecayFits, EveryMissingValueHasItsReason) {
  expect_none(measure_band({}, 0.001, 0), DecayStatus::silent);
  expect_none(measure_band(std::vector<double>(100, 0.0), 0.001, 0), DecayStatus::silent);
  expect_none(measure_band(std::vector<double>{1, kNan, 1, 1}, 0.001, 1), DecayStatus::silent);
  expect_none(measure_band(std::vector<double>{1, kInfinity, 1, 1}, 0.001, 1), DecayStatus::silent);
  expect_none(measure_band(std::vector<double>(100, 0.0), 0.001, 1), DecayStatus::no_reverberation);
  expect_none(measure_band(std::vector<double>{1, 0.5}, 0.001, 1), DecayStatus::too_few_points);
  expect_none(measure_band(std::vector<double>{1, 0, 0, 0, 0, 0, 0, 0, 0, 0}, 0.001, 0), DecayStatus::too_few_points);
  expect_none(measure_band(std::vector<double>(500, 1e-3), 0.001, 0.5), DecayStatus::no_decay);  // T = infinity
  expect_none(measure_band(decay(10, 0.001, 0.5), 0.001, 0), DecayStatus::cut_short);            // ends 3 dB down
  EXPECT_EQ(measure_band(decay(0.3, 0.001, 0.5), 0.001, 0).decay, DecayStatus::measured);
}

TEST(H75_DecayFits, AResponseThatGrowsHasNoDecayTime) {
  std::vector<double> growing = decay(0.3, 0.001, 0.5);
  std::reverse(growing.begin(), growing.end());
  expect_none(measure_band(growing, 0.001, 0), DecayStatus::no_decay);
  // A decay into a floor that rises: what is trusted is right, what is not is missing.  No outlier rule may turn 300 into 40 ms.
  std::vector<double> floor = decay(0.3, 0.001, 1.0);
  for (std::size_t i = 0; i < floor.size(); ++i) floor[i] += 1e-8 * (1 + static_cast<double>(i) / 500);
  const BandMetrics band = measure_band(floor, 0.001, 0);
  ASSERT_TRUE(band.t20_s);
  EXPECT_NEAR(*band.t20_s, 0.3, 0.02 * 0.3);
  if (band.t30_s) {
    EXPECT_NEAR(*band.t30_s, 0.3, 0.05 * 0.3);
  }
}

TEST(H75_DecayFits, OneOutlierDoesNotMoveTheDecayTenfold) {
  // pyroomacoustics #358: one strong late reflection.  A bin of 1 % of the energy at 100 ms of a decay of 0.3 s.
  std::vector<double> energy = decay(0.3, 0.001, 0.6);
  energy[100] += 0.01;
  const BandMetrics band = measure_band(energy, 0.001, 0);
  ASSERT_TRUE(band.t20_s && band.t30_s);
  // Exactly: the curve is raised by up to 10 log10(1 + 1) before the bin and as before after it: between -5 and -25 dB that is some per
  // cent.
  EXPECT_NEAR(*band.t20_s, 0.3, 0.2 * 0.3);
  EXPECT_NEAR(*band.t30_s, 0.3, 0.2 * 0.3);
}

TEST(H75_DecayFits, TwoSlopesFollowTheFit) {
  // 0.2 s and, 20 dB below, 2 s.  T20 and T30 from the closed-form curve, by a fine least-squares line of the test's own.
  const double fast = 6 * std::numbers::ln10 / 0.2, slow = 6 * std::numbers::ln10 / 2.0;
  std::vector<double> energy = decay(0.2, 0.001, 3.0);
  const std::vector<double> second = decay(2.0, 0.001, 3.0, 0.01);
  for (std::size_t i = 0; i < energy.size(); ++i) energy[i] += second[i];
  const auto level_db = [&](double t) { return 10 * std::log10((std::exp(-fast * t) + 0.01 * std::exp(-slow * t)) / 1.01); };
  const auto fitted = [&](double from_db, double to_db) {
    double n = 0, st = 0, sl = 0, stt = 0, stl = 0;
    for (double t = 0; t < 3; t += 1e-5) {
      const double l = level_db(t);
      if (l > from_db || l < to_db) continue;
      n += 1, st += t, sl += l, stt += t * t, stl += t * l;
    }
    return -60 / ((n * stl - st * sl) / (n * stt - st * st));
  };
  const BandMetrics band = measure_band(energy, 0.001, 0);
  ASSERT_TRUE(band.t20_s && band.t30_s);
  EXPECT_NEAR(*band.t20_s / fitted(-5, -25), 1.0, 0.01);
  EXPECT_NEAR(*band.t30_s / fitted(-5, -35), 1.0, 0.01);
}

TEST(H75_DecayFits, AnyScaleGivesTheSameTimes) {
  const BandMetrics reference = measure_band(decay(0.4, 0.004, 0.6), 0.004, 0.1);
  for (const double scale : {1e-280, 1e-40, 1e-20, 1e20, 1e40, 1e280}) {
    const BandMetrics band = measure_band(decay(0.4, 0.004, 0.6, scale), 0.004, 0.1 * scale);
    ASSERT_TRUE(band.t20_s && band.t30_s && band.edt_s && band.drr_db) << scale;
    EXPECT_NEAR(*band.t20_s / *reference.t20_s, 1.0, 1e-9) << scale;
    EXPECT_NEAR(*band.drr_db, *reference.drr_db, 1e-9) << scale;
  }
}

TEST(H75_DecayFits, RenderedResponsesOfNothingAndOfOneSample) {
  for (const std::size_t samples : {std::size_t{1}, std::size_t{2}, std::size_t{7}, std::size_t{400}}) {
    std::vector<float> rir(samples, 0.f);
    const RoomMetrics silent = measure(rir, 16000.f, 0);
    engines::expect_sound(silent);
    for (const BandMetrics& band : silent.bands) EXPECT_EQ(band.decay, DecayStatus::silent);
    rir[0] = 1.f;
    engines::expect_sound(measure(rir, 16000.f, 0));
    EXPECT_THROW((void)measure(rir, 16000.f, 1e9), InputError);  // the direct sound long after the end
  }
}

}  // namespace
}  // namespace earshot
