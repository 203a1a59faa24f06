// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/energy_decay.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/image_sum.h"

namespace earshot {
namespace {

/// Ideal decay of total energy 1: exact energy of each bin, cut after length_s.
std::vector<double> exponential(double t60_s, double bin_s, double length_s) {
  const double k = 6 * std::numbers::ln10 / t60_s;
  std::vector<double> energy(static_cast<std::size_t>(std::lround(length_s / bin_s)));
  for (std::size_t i = 0; i < energy.size(); ++i) {
    energy[i] = std::exp(-k * bin_s * static_cast<double>(i)) * -std::expm1(-k * bin_s);
  }
  return energy;
}

TEST(EnergyDecayCurve, SumsBackwardInDoubleH40) {
  std::vector<double> energy(10'000'000, 0.1), edc(energy.size());
  energy_decay_curve(energy, edc);
  EXPECT_NEAR(edc[0], 1e6, 1.0);  // a float sum gives 1 087 937
  EXPECT_EQ(edc.back(), 0.1);
  std::vector<double> three(3);
  energy_decay_curve(std::vector<double>{4, 2, 1}, three);
  EXPECT_EQ(three, (std::vector<double>{7, 3, 1}));
  EXPECT_THROW(energy_decay_curve(energy, three), InputError);
}

TEST(RoomMetrics, IdealDecayO25) {
  struct Row {
    double t60_s, c50, c80, d50, ts_ms;
  };
  const Row rows[] = {{0.1, 29.9957, 47.9999, 0.99900, 7.2382},   {0.2, 14.8604, 23.9827, 0.96838, 14.4765},
                      {0.3, 9.5424, 15.8895, 0.90000, 21.7147},   {0.5, 4.7437, 9.0956, 0.74881, 36.1912},
                      {0.8, 1.3716, 4.7437, 0.57830, 57.9059},    {1.0, -0.0206, 3.0534, 0.49881, 72.3824},
                      {1.5, -2.3292, 0.3715, 0.36904, 108.5736},  {2.0, -3.8454, -1.3206, 0.29205, 144.7648},
                      {3.0, -5.8683, -3.5121, 0.20567, 217.1472}, {5.0, -8.2929, -6.0663, 0.12904, 361.9121}};
  for (const Row& row : rows) {
    const BandMetrics m = measure_band(exponential(row.t60_s, 0.001, 1.5 * row.t60_s), 0.001, 0);
    ASSERT_TRUE(m.edt_s && m.t20_s && m.t30_s && m.rt60_s && m.c50_db && m.c80_db && m.d50 && m.ts_s);
    // Cut at -90 dB: no bias.  The curve is exact at bin edges, so the decay times are exact to rounding and to the cut.
    for (const auto& t : {m.edt_s, m.t20_s, m.t30_s, m.rt60_s}) EXPECT_NEAR(*t, row.t60_s, 2e-6 * row.t60_s);
    EXPECT_NEAR(*m.c50_db, row.c50, 2e-4);
    EXPECT_NEAR(*m.c80_db, row.c80, 2e-3);
    EXPECT_NEAR(*m.d50, row.d50, 1e-5);
    EXPECT_NEAR(1e3 * *m.ts_s, row.ts_ms, 2e-3 + 0.04);  // a bin of 1 ms is taken at its middle: up to 0.04 ms at T = 0.1 s
    EXPECT_FALSE(m.drr_db);                              // no direct sound: minus infinity does not exist
    EXPECT_NEAR(*m.g_db, 10 * std::log10(1 / 6.332574e-5), 1e-3);
  }
}

TEST(RoomMetrics, DirectSoundBeforeTheDecayO25) {
  struct Row {
    double t60_s, drr_db, c50, c80, d50, ts_ms;
  };
  for (const Row& row : {Row{0.5, 0, 8.4274, 12.3654, 0.87441, 18.0956}, Row{0.5, 5, 11.9230, 15.6774, 0.93965, 8.6950},
                         Row{0.5, -5, 6.2737, 10.4156, 0.80916, 27.4962}, Row{1.0, 0, 4.7575, 7.0242, 0.74941, 36.1912},
                         Row{1.0, -10, 0.7729, 3.6585, 0.54438, 65.8022}}) {
    const BandMetrics m = measure_band(exponential(row.t60_s, 0.001, 1.5 * row.t60_s), 0.001, std::pow(10, row.drr_db / 10));
    ASSERT_TRUE(m.edt_after_direct_s && m.t20_s && m.t30_s && m.drr_db);
    EXPECT_NEAR(*m.drr_db, row.drr_db, 1e-6);
    EXPECT_NEAR(*m.c50_db, row.c50, 2e-4);
    EXPECT_NEAR(*m.c80_db, row.c80, 2e-4);
    EXPECT_NEAR(*m.d50, row.d50, 1e-5);
    EXPECT_NEAR(1e3 * *m.ts_s, row.ts_ms, 0.01);
    for (const auto& t : {m.edt_after_direct_s, m.t20_s, m.t30_s}) EXPECT_NEAR(*t, row.t60_s, 1e-5 * row.t60_s);
  }
}

TEST(RoomMetrics, CoarseBinsChangeNothing) {
  for (const double bin_s : {0.0005, 0.002, 0.004, 0.01}) {
    const BandMetrics m = measure_band(exponential(0.4, bin_s, 0.6), bin_s, 0.1);
    ASSERT_TRUE(m.edt_after_direct_s && m.t20_s && m.t30_s);
    EXPECT_NEAR(*m.edt_after_direct_s, 0.4, 1e-5);
    EXPECT_NEAR(*m.t20_s, 0.4, 1e-5);
    EXPECT_NEAR(*m.t30_s, 0.4, 1e-5);
  }
}

/// Least squares over samples of the decay curve 1 ms apart from 0 to -10 dB, direct sound included (ISO 3382-1:2009, A.2.2).
double regression_edt_s(std::vector<double> energy, double direct_energy) {
  energy[0] += direct_energy;
  return decay::time_s(energy, 0.001, 0, -10);
}

// A step of 0.6 to 6.2 dB and an exponential behind it: the line through the step is up to a third steeper than the decay.
TEST(RoomMetrics, EarlyDecayTimeIncludesTheDirectStepO25) {
  const RandomStream random(38, Purpose::test, 1);
  double largest = 0;
  for (std::uint32_t draw = 0; draw < 20; ++draw) {
    const double t60_s = 0.5 + 2.0 * static_cast<double>(random.uniform(2 * draw));
    const double drr_db = -8 + 13.0 * static_cast<double>(random.uniform(2 * draw + 1)), direct = std::pow(10, drr_db / 10);
    const std::vector<double> energy = exponential(t60_s, 0.001, 1.5 * t60_s);
    const BandMetrics m = measure_band(energy, 0.001, direct);
    ASSERT_TRUE(m.edt_s && m.edt_after_direct_s);
    const double expected_s = regression_edt_s(energy, direct);
    EXPECT_NEAR(*m.edt_s / expected_s, 1, 1e-6) << t60_s << " s, " << drr_db << " dB";
    EXPECT_NEAR(*m.edt_after_direct_s, t60_s, 1e-5 * t60_s);
    largest = std::max(largest, *m.edt_after_direct_s / *m.edt_s);
  }
  EXPECT_GT(largest, 1.08) << "the test sees the difference";
  // 10.4 dB of step: nothing is left of the first 10 dB.
  EXPECT_FALSE(measure_band(exponential(1.0, 0.001, 1.5), 0.001, 10).edt_s);
}

// Near a source the first reflections come in a burst and the rest falls slowly: 5 dB of step, 5 dB in 20 ms, then 60 dB in a second.
TEST(RoomMetrics, EarlyDecayTimeNearASource) {
  std::vector<double> energy(1500, 0.0);
  double left = std::pow(10, -0.5);
  for (std::size_t i = 0; i < energy.size(); ++i) {
    const double next = left * std::pow(10, i < 20 ? -0.025 : -0.006);
    energy[i] = left - next;
    left = next;
  }
  const BandMetrics m = measure_band(energy, 0.001, 1 - std::pow(10, -0.5));
  ASSERT_TRUE(m.edt_s && m.edt_after_direct_s);
  EXPECT_NEAR(*m.edt_s, regression_edt_s(energy, 1 - std::pow(10, -0.5)), 0.1 * *m.edt_s);  // a sample at -10 dB is in or out
  EXPECT_GT(*m.edt_after_direct_s, 2 * *m.edt_s) << "the first 10 dB below the step reach into the slow decay";
}

// All images of SHOE-1 from the direct arrival on in bins of 1 ms: the row EDT of O-4.
TEST(RoomMetrics, EarlyDecayTimeOfABoxOfMirrorsO4) {
  constexpr double kFineS = 1e-5;
  const double distance_m = std::sqrt(2.6 * 2.6 + 0.8 * 0.8 + 0.5 * 0.5);
  const auto first = static_cast<std::size_t>(distance_m / 343.0 / kFineS);
  for (const auto& [absorption, edt_s] : {std::pair(0.1, 1.0223), std::pair(0.2, 0.47944), std::pair(0.5, 0.13595)}) {
    const std::vector<double> fine = image_sum::energy_series({5, 4, 3}, absorption, {1.2, 1.5, 1.1}, {3.8, 2.3, 1.6}, kFineS, 0.9);
    std::vector<double> energy(850, 0.0);
    for (std::size_t i = first + 1; i < fine.size(); ++i)
      if ((i - first) / 100 < energy.size()) energy[(i - first) / 100] += fine[i];
    const BandMetrics m = measure_band(energy, 0.001, fine[first]);
    ASSERT_TRUE(m.edt_s.has_value()) << absorption;
    EXPECT_NEAR(*m.edt_s / edt_s, 1, 0.02) << absorption;
  }
}

TEST(RoomMetrics, TruncatedResponsesAreNotTrustedO25) {
  // Cut at -60 dB: all; at -40: T20 but not T30; at -25: EDT only; at -15: nothing.
  const auto cut_at = [](double level_db) { return measure_band(exponential(1.0, 0.001, level_db / 60.0), 0.001, 0); };
  const BandMetrics full = cut_at(60), to_40 = cut_at(40), to_25 = cut_at(25), to_15 = cut_at(15);
  ASSERT_TRUE(full.t30_s);
  EXPECT_NEAR(*full.t30_s, 1.0, 0.0004);  // the table says -0.028 %
  EXPECT_FALSE(to_40.t30_s);
  ASSERT_TRUE(to_40.t20_s && to_40.rt60_s);
  EXPECT_NEAR(*to_40.t20_s, 1.0 - 0.0051, 0.0015);  // the table says -0.5105 % for a fit over samples
  EXPECT_EQ(*to_40.rt60_s, *to_40.t20_s);
  EXPECT_FALSE(to_25.t20_s);
  EXPECT_TRUE(to_25.edt_s);
  EXPECT_FALSE(to_25.rt60_s);
  EXPECT_FALSE(to_15.edt_s);
  const BandMetrics to_46 = cut_at(46);  // just enough for T30
  ASSERT_TRUE(to_46.t30_s);
  EXPECT_NEAR(*to_46.t30_s, 1.0, 0.01);
}

TEST(RoomMetrics, LosslessRoomHasNoDecayTimeH21) {
  const BandMetrics m = measure_band(std::vector<double>(500, 1e-3), 0.001, 0.5);
  EXPECT_FALSE(m.edt_s || m.t20_s || m.t30_s || m.rt60_s);
  ASSERT_TRUE(m.d50);
  EXPECT_NEAR(*m.d50, 0.55, 1e-9);
}

TEST(RoomMetrics, DirectSoundAloneH22) {
  const BandMetrics m = measure_band(std::vector<double>(100, 0.0), 0.001, 1.0);
  EXPECT_FALSE(m.edt_s || m.t20_s || m.t30_s || m.rt60_s || m.drr_db || m.c50_db || m.c80_db);
  EXPECT_EQ(*m.d50, 1.0);
  EXPECT_EQ(*m.ts_s, 0.0);
}

TEST(RoomMetrics, SilenceAndTooFewPointsH75) {
  const BandMetrics silent = measure_band(std::vector<double>(100, 0.0), 0.001, 0);
  EXPECT_FALSE(silent.edt_s || silent.d50 || silent.ts_s || silent.g_db);
  EXPECT_FALSE(measure_band({}, 0.001, 0).d50);
  EXPECT_FALSE(measure_band(std::vector<double>{1, 0, 0, 0}, 0.001, 0).t20_s);
  std::vector<double> steep = exponential(0.004, 0.001, 0.02);  // 15 dB per bin: two points in 20 dB
  const BandMetrics m = measure_band(steep, 0.001, 0);
  EXPECT_NEAR(m.t20_s.value_or(0.004), 0.004, 0.0005);  // either refused or right
}

}  // namespace
}  // namespace earshot
