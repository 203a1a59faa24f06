// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/room_metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/base/errors.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

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
  EXPECT_NEAR(*m.edt_after_direct_s, t60_s, 0.02 * t60_s);  // the 4 ms bins round off the start
  EXPECT_NEAR(*m.d50, 0.95, 0.002);                         // (1 + 0.9) / 2
  EXPECT_NEAR(1e3 * *m.ts_s, 21.7147 / 2, 0.1);
}

/// Direct sound of amplitude 1 and diffracted sound of 0.5, `after_s` later and `phase_rad` ahead, in one band.
RoomMetrics of_direct_and_diffracted(const AcousticScene& scene, int band, double after_s, double phase_rad) {
  EnergyResponse response;
  response.late = make_histogram(scene);
  const double speed = scene.speed_of_sound_m_per_s();
  Arrival& direct = response.arrivals.emplace_back();
  direct.distance_m = static_cast<float>(0.01 * speed);
  direct.amplitude[static_cast<std::size_t>(band)] = 1.f;
  Arrival& diffracted = response.arrivals.emplace_back();
  diffracted.kind = ArrivalKind::diffraction;
  diffracted.distance_m = static_cast<float>((0.01 + after_s) * speed);
  diffracted.amplitude[static_cast<std::size_t>(band)] = 0.5f;
  diffracted.phase_rad[static_cast<std::size_t>(band)] = static_cast<float>(phase_rad);
  return measure(scene, response);
}

// Sound diffracted within 1.5 ms is part of the direct sound, half of it at 2 ms, none from 2.5 ms on.  In a band this wide what is
// milliseconds apart hardly interferes: energies add, 1 and 0.25, but for 2 a b sinc(bandwidth t), at most 1 / (pi bandwidth t).
TEST(RoomMetrics, DiffractedSoundCountsAsDirectForTwoMilliseconds) {
  AcousticConfig config;
  config.bands = 1;
  const AcousticScene scene(rooms::shoe1(0.2, 1), config);
  const double bandwidth_hz = scene.bands().edge_hz[1] - scene.bands().edge_hz[0];
  const auto expect_drr = [&](double after_s, double direct, double rest) {
    const double tolerance_db = 10 * std::log10(1 + 1 / (std::numbers::pi * bandwidth_hz * after_s)) + 0.01;
    EXPECT_LT(tolerance_db, 0.1);
    EXPECT_NEAR(*of_direct_and_diffracted(scene, 0, after_s, 0).drr_db, 10 * std::log10(direct / rest), tolerance_db) << after_s;
  };
  EXPECT_FALSE(of_direct_and_diffracted(scene, 0, 0.001, 0).drr_db) << "nothing comes after it";
  expect_drr(0.002, 1.125, 0.125);
  for (const double after_s : {0.0026, 0.005, 0.02}) expect_drr(after_s, 1, 0.25);
}

// Against the integral of |1 + 0.5 exp(j (p - 2 pi f t))|^2 over the band, by midpoints.
TEST(RoomMetrics, DirectAndDiffractedSoundInterfereByDelayAndPhase) {
  const AcousticScene scene(rooms::shoe1(0.2, 1), AcousticConfig{});
  double least = 2, most = 0;
  for (int band = 0; band < scene.num_bands(); ++band)
    for (const double after_s : {0.0, 0.0003, 0.0011})
      for (const double phase_rad : {-2.0, 0.0, 1.0, 3.0}) {
        const double low_hz = scene.bands().edge_hz[band], high_hz = scene.bands().edge_hz[band + 1];
        double sum = 0;
        constexpr int kPoints = 4000;
        for (int i = 0; i < kPoints; ++i) {
          const double f_hz = low_hz + (high_hz - low_hz) * (i + 0.5) / kPoints;
          sum += std::norm(1.0 + 0.5 * std::polar(1.0, phase_rad - 2 * std::numbers::pi * f_hz * after_s)) / kPoints;
        }
        double bandwidth_hz = 0;
        for (int b = 0; b < scene.num_bands(); ++b) bandwidth_hz += scene.bands().edge_hz[b + 1] - scene.bands().edge_hz[b];
        const double amplitude = *of_direct_and_diffracted(scene, band, after_s, phase_rad).direct_amplitude;
        const double energy = amplitude * amplitude * bandwidth_hz / (high_hz - low_hz);
        EXPECT_NEAR(energy, sum, 2e-3) << "band " << band << ", " << after_s << " s, " << phase_rad << " rad";  // distances are floats
        least = std::min(least, sum);
        most = std::max(most, sum);
      }
  EXPECT_LT(least, 0.5) << "some cancel";
  EXPECT_GT(most, 2.0) << "some add";
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
    EXPECT_EQ(metrics.bands.size(), rate == 8000.f ? 6u : 8u);
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
