#include "sim/acoustics/metrics/room_metrics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/base/errors.h"
#include "tests/support/rooms.h"

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
    ASSERT_TRUE(m.edt_s && m.t20_s && m.t30_s && m.drr_db);
    EXPECT_NEAR(*m.drr_db, row.drr_db, 1e-6);
    EXPECT_NEAR(*m.c50_db, row.c50, 2e-4);
    EXPECT_NEAR(*m.c80_db, row.c80, 2e-4);
    EXPECT_NEAR(*m.d50, row.d50, 1e-5);
    EXPECT_NEAR(1e3 * *m.ts_s, row.ts_ms, 0.01);
    for (const auto& t : {m.edt_s, m.t20_s, m.t30_s}) EXPECT_NEAR(*t, row.t60_s, 1e-5 * row.t60_s);
  }
}

TEST(RoomMetrics, CoarseBinsChangeNothing) {
  for (const double bin_s : {0.0005, 0.002, 0.004, 0.01}) {
    const BandMetrics m = measure_band(exponential(0.4, bin_s, 0.6), bin_s, 0.1);
    ASSERT_TRUE(m.edt_s && m.t20_s && m.t30_s);
    EXPECT_NEAR(*m.edt_s, 0.4, 1e-5);
    EXPECT_NEAR(*m.t20_s, 0.4, 1e-5);
    EXPECT_NEAR(*m.t30_s, 0.4, 1e-5);
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

TEST(RoomMetrics, TimeZeroIsTheDirectArrival) {
  // Direct at 100.3 ms, decay of T = 0.3 s from there on, as late bins of 4 ms: all parameters are those of time zero at the direct.
  AcousticConfig config;
  config.bands = 1;
  config.air_absorption = Switch::off;
  config.rir_length_s = 1.f;
  const AcousticScene scene(rooms::shoe1(0.2, 1), config);
  EnergyResponse response;
  response.late = make_histogram(scene);
  const double t60_s = 0.3, k = 6 * std::numbers::ln10 / t60_s, start_s = 0.1003;
  const std::vector<float> sh = {1, 0, 0, 0};
  for (double t = 5e-5; t < 0.85; t += 1e-4) {
    response.late.add(static_cast<float>(start_s + t), std::vector<float>{static_cast<float>(k * 1e-4 * std::exp(-k * t))}, sh);
  }
  Arrival& direct = response.arrivals.emplace_back();
  direct.distance_m = static_cast<float>(start_s * 343);
  direct.amplitude[0] = 1.f;
  const RoomMetrics metrics = measure(scene, response);
  ASSERT_EQ(metrics.bands.size(), 1u);
  const BandMetrics& m = metrics.bands[0];
  EXPECT_NEAR(*metrics.direct_delay_s, start_s, 1e-6);
  EXPECT_NEAR(*metrics.direct_amplitude, 1.0, 1e-6);
  EXPECT_NEAR(*metrics.drr_db, 0.0, 0.01);
  EXPECT_NEAR(*m.drr_db, 0.0, 0.01);
  EXPECT_NEAR(*m.t30_s, t60_s, 0.002 * t60_s);
  EXPECT_NEAR(*m.edt_s, t60_s, 0.02 * t60_s);  // the 4 ms bins round off the start
  EXPECT_NEAR(*m.d50, 0.95, 0.002);            // (1 + 0.9) / 2
  EXPECT_NEAR(1e3 * *m.ts_s, 21.7147 / 2, 0.1);
}

TEST(RoomMetrics, OpenFieldHasNoDecayO7) {
  AcousticConfig config = rooms::plain_config();
  config.early = Switch::automatic;
  const AcousticScene scene(rooms::half_space(0, 0), config);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, rooms::point(0, 0, 1.5)), rooms::point(10, 0, 1.5), response);
  const RoomMetrics metrics = measure(scene, response);
  const BandMetrics& m = metrics.bands[0];
  EXPECT_FALSE(m.edt_s || m.t20_s || m.t30_s || m.rt60_s);
  ASSERT_TRUE(m.drr_db && metrics.drr_db);
  EXPECT_NEAR(*m.drr_db, 0.37426, 1e-3);  // E2 / E1 of HS1
  EXPECT_FALSE(m.c50_db);                 // nothing is late
  EXPECT_EQ(*m.d50, 1.0);
}

TEST(RoomMetrics, WithoutLineOfSight) {
  AcousticConfig config = rooms::plain_config();
  const AcousticScene scene(rooms::shoe1(0.2, 1), config);
  EnergyResponse response;
  response.late = make_histogram(scene);
  RoomMetrics metrics = measure(scene, response);  // silence
  EXPECT_FALSE(metrics.direct_delay_s || metrics.drr_db || metrics.bands.at(0).t30_s);
  response.late.add(0.05f, std::vector<float>{1.f}, std::vector<float>{1.f});
  metrics = measure(scene, response);
  EXPECT_FALSE(metrics.direct_delay_s || metrics.direct_amplitude || metrics.drr_db);
  EXPECT_NEAR(*metrics.bands[0].d50, 1.0, 1e-9);  // time zero is the first arrival
}

TEST(RirMetrics, TwoImpulses) {
  // 0.1 at 20 ms and 0.05 at 120 ms: every band reads the same, in Green units.
  std::vector<float> rir(16000, 0.f);
  rir[320] = 0.1f;
  rir[1920] = 0.05f;
  const RoomMetrics metrics = measure(rir, 16000.f, 0.02);
  ASSERT_EQ(metrics.bands.size(), 7u);
  EXPECT_NEAR(*metrics.direct_amplitude, 0.1, 1e-6);
  EXPECT_NEAR(*metrics.drr_db, 6.0206, 1e-3);
  for (const BandMetrics& m : metrics.bands) {
    ASSERT_TRUE(m.drr_db && m.g_db && m.d50);
    EXPECT_NEAR(*m.drr_db, 6.0206, 0.01);
    EXPECT_NEAR(*m.g_db, 10 * std::log10(0.0125 / 6.332574e-5), 0.01);
    EXPECT_NEAR(*m.d50, 0.8, 0.01);
    EXPECT_NEAR(1e3 * *m.ts_s, 20.0, 0.5);  // 0.2 * 100 ms
  }
}

TEST(RirMetrics, DecayPerBand) {
  // A decaying tone in each octave, each with its own T, after a small impulse.
  const double rate = 16000, t60_s[] = {1.2, 1.0, 0.8, 0.7, 0.5, 0.4};
  const double tone_hz[] = {125.9, 251.2, 501.2, 1000, 1995, 3981};
  std::vector<float> rir(32000, 0.f);
  for (std::size_t i = 0; i + 160 < rir.size(); ++i) {
    const double t = static_cast<double>(i) / rate;
    double sum = 0;
    for (int b = 0; b < 6; ++b) {
      sum += std::sin(2 * std::numbers::pi * tone_hz[b] * t) * std::exp(-3 * std::numbers::ln10 * t / t60_s[b]);
    }
    rir[i + 160] = static_cast<float>(sum);
  }
  const RoomMetrics metrics = measure(rir, 16000.f, 0.01);
  for (int b = 0; b < 6; ++b) {
    ASSERT_TRUE(metrics.bands[b].t30_s && metrics.bands[b].t20_s) << b;
    // The switch-on of the other tones leaks over the band for a few periods; below -5 dB of the curve little of it is left.
    EXPECT_NEAR(*metrics.bands[b].t20_s, t60_s[b], 0.02 * t60_s[b]) << b;
    EXPECT_NEAR(*metrics.bands[b].t30_s, t60_s[b], 0.02 * t60_s[b]) << b;
  }
}

TEST(RirMetrics, OtherRatesAndBadInput) {
  for (const float rate : {8000.f, 44100.f, 48000.f}) {
    std::vector<float> rir(static_cast<std::size_t>(rate), 0.f);
    rir[static_cast<std::size_t>(0.01 * rate)] = 1.f;
    rir[static_cast<std::size_t>(0.1 * rate)] = 0.1f;
    const RoomMetrics metrics = measure(rir, rate, 0.01);
    EXPECT_EQ(metrics.bands.size(), rate == 8000.f ? 6u : 7u);
    for (const BandMetrics& m : metrics.bands) EXPECT_NEAR(*m.drr_db, 20.0, 0.05);
  }
  EXPECT_THROW(measure(std::span<const float>{}, 16000.f, 0.0), InputError);
  EXPECT_THROW(measure(std::vector<float>(10, 0.f), 16000.f, -1.0), InputError);
  const RoomMetrics silent = measure(std::vector<float>(1000, 0.f), 16000.f, 0.01);
  EXPECT_FALSE(silent.drr_db || silent.direct_delay_s || silent.bands[0].t20_s);
  EXPECT_EQ(measure(std::vector<float>(1, 1.f), 16000.f, 0.0).bands.size(), 7u);  // H-33
}

}  // namespace
}  // namespace earshot
