// SPDX-License-Identifier: Apache-2.0
// Speech transmission against closed forms: exponential decay, noise and one echo.
#include "sim/acoustics/metrics/speech_transmission.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <vector>

#include "sim/acoustics/core/bands.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr double kSpeechBinS = 0.001;
constexpr double kInfiniteDb = std::numeric_limits<double>::infinity();

double drawn_between(std::uint32_t stream, std::uint32_t draw, double low, double high) {
  return low + (high - low) * static_cast<double>(RandomStream(38, Purpose::test, 4, stream).uniform(draw));
}

std::vector<double> exponential_energy(double t60_s) {
  const double k = 6 * std::numbers::ln10 / t60_s;
  std::vector<double> energy(static_cast<std::size_t>(2 * t60_s / kSpeechBinS));
  for (std::size_t i = 0; i < energy.size(); ++i)
    energy[i] = std::exp(-k * kSpeechBinS * static_cast<double>(i)) * -std::expm1(-k * kSpeechBinS);
  return energy;
}

/// Mean over the 14 modulation frequencies of the index of m, by the formulas of IEC 60268-16.
template <class Modulation>
double index_of(const Modulation& modulation) {
  double sum = 0;
  for (const double hz : {0.63, 0.80, 1.00, 1.25, 1.60, 2.00, 2.50, 3.15, 4.00, 5.00, 6.30, 8.00, 10.0, 12.5}) {
    const double m = modulation(hz), ratio_db = 10 * std::log10(m / (1 - m));
    sum += (std::min(15.0, std::max(-15.0, ratio_db)) + 15) / 30;
  }
  return sum / 14;
}

// m = 1 / sqrt(1 + (2 pi F T / 13.8)^2) (Houtgast and Steeneken 1985); the bins move energy by half a bin: 1e-4.
TEST(SpeechTransmission, OfAnExponentialDecay) {
  for (std::uint32_t draw = 0; draw < 15; ++draw) {
    const double t60_s = drawn_between(1, draw, 0.2, 5);
    const std::vector<double> energy = exponential_energy(t60_s);
    const auto expected = [&](double hz) {
      return 1 / std::sqrt(1 + std::pow(2 * std::numbers::pi * hz * t60_s / (6 * std::numbers::ln10), 2));
    };
    for (const double hz : kModulationHz)
      EXPECT_NEAR(modulation_transfer(energy, kSpeechBinS, 0, hz), expected(hz), 2e-4) << t60_s << " " << hz;
    EXPECT_NEAR(*modulation_transfer_index(energy, kSpeechBinS, 0, kInfiniteDb), index_of(expected), 1e-3) << t60_s;
  }
}

// Noise leaves 1 / (1 + 10^(-SNR / 10)) of every modulation, so that the apparent ratio is the ratio itself.
TEST(SpeechTransmission, OfNoise) {
  const std::vector<double> nothing(500, 0.0);
  for (std::uint32_t draw = 0; draw < 15; ++draw) {
    const double snr_db = drawn_between(2, draw, -20, 20);
    const double expected = (std::clamp(snr_db, -15.0, 15.0) + 15) / 30;
    EXPECT_NEAR(*modulation_transfer_index(nothing, kSpeechBinS, 1, snr_db), expected, 1e-9) << snr_db;
  }
  EXPECT_EQ(*modulation_transfer_index(nothing, kSpeechBinS, 1, kInfiniteDb), 1.0);
  EXPECT_FALSE(modulation_transfer_index(nothing, kSpeechBinS, 0, kInfiniteDb));
}

// One echo: m = |1 + g exp(-2 pi i F t)| / (1 + g).
TEST(SpeechTransmission, OfOneEcho) {
  for (std::uint32_t draw = 0; draw < 15; ++draw) {
    const double gain = drawn_between(3, 2 * draw, 0.05, 2);
    const auto bin = static_cast<std::size_t>(drawn_between(3, 2 * draw + 1, 5, 400));
    std::vector<double> energy(500, 0.0);
    energy[bin] = gain;
    const double delay_s = kSpeechBinS * (static_cast<double>(bin) + 0.5);
    for (const double hz : kModulationHz) {
      const double expected = std::abs(1.0 + gain * std::polar(1.0, -2 * std::numbers::pi * hz * delay_s)) / (1 + gain);
      EXPECT_NEAR(modulation_transfer(energy, kSpeechBinS, 1, hz), expected, 5e-4) << gain << " " << delay_s << " " << hz;
    }
  }
}

// Weights and redundancy factors add up to 1: seven equal indices are the result.
TEST(SpeechTransmission, EqualOctavesGiveTheirIndex) {
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    std::array<double, kSpeechOctaves> mti{};
    mti.fill(drawn_between(4, draw, 0, 1));
    EXPECT_NEAR(speech_transmission_index(mti), mti[0], 1e-9);
  }
}

// Table A.1, male spectrum: weights of the octaves, and of the geometric means of neighbours.
TEST(SpeechTransmission, HasTheCoefficientsOfTheTable) {
  constexpr std::array<double, 7> alpha{0.085, 0.127, 0.230, 0.233, 0.309, 0.224, 0.173};
  constexpr std::array<double, 6> beta{0.085, 0.078, 0.065, 0.011, 0.047, 0.095};
  for (std::size_t k = 0; k < 7; ++k)
    for (std::uint32_t draw = 0; draw < 4; ++draw) {
      const auto stream = static_cast<std::uint32_t>(40 + k);
      std::array<double, kSpeechOctaves> mti{};
      mti[k] = drawn_between(stream, 2 * draw, 0.1, 0.4);
      EXPECT_NEAR(speech_transmission_index(mti), alpha[k] * mti[k], 1e-12) << k;
      if (k == 6) continue;
      mti[k + 1] = drawn_between(stream, 2 * draw + 1, 0.5, 1);
      EXPECT_NEAR(speech_transmission_index(mti), alpha[k] * mti[k] + alpha[k + 1] * mti[k + 1] - beta[k] * std::sqrt(mti[k] * mti[k + 1]),
                  1e-12)
          << k;
    }
}

TEST(SpeechTransmission, NeedsItsSevenOctaves) {
  EXPECT_TRUE(speech_octaves(BandLayout::octaves(16000).centre_hz));
  EXPECT_TRUE(speech_octaves(BandLayout::octaves(48000).centre_hz));
  EXPECT_FALSE(speech_octaves(BandLayout::octaves(8000).centre_hz));
  EXPECT_FALSE(speech_octaves(BandLayout::third_octaves(48000).centre_hz));
  for (const int bands : {1, 7, 16, 24}) EXPECT_FALSE(speech_octaves(BandLayout::log_spaced(bands, 48000).centre_hz)) << bands;
}

/// Sum of tones at the octaves' centres with an envelope: its energy in every octave follows the squared envelope.
template <class Envelope>
std::vector<float> tones(const Envelope& envelope, double length_s) {
  constexpr double rate_hz = 32000;
  std::vector<float> samples(static_cast<std::size_t>(length_s * rate_hz));
  for (std::size_t n = 0; n < samples.size(); ++n) {
    const double t = static_cast<double>(n) / rate_hz;
    double sum = 0;
    for (int k = -3; k <= 3; ++k) sum += std::sin(2 * std::numbers::pi * 1000 * std::pow(10, 0.3 * k) * t);
    samples[n] = static_cast<float>(envelope(t) * sum);
  }
  return samples;
}

// In samples: the switch-on of the tones leaks between octaves for a few periods, which moves the index by less than 0.01.
TEST(SpeechTransmission, OfSamplesThatDecay) {
  ParameterRequest request;
  request.speech = true;
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const double t60_s = drawn_between(5, 2 * draw, 0.4, 3), snr_db = drawn_between(5, 2 * draw + 1, -6, 12);
    const std::vector<float> rir = tones([&](double t) { return std::exp(-3 * std::numbers::ln10 * t / t60_s); }, 1.3 * t60_s);
    const auto decayed = [&](double hz) {
      return 1 / std::sqrt(1 + std::pow(2 * std::numbers::pi * hz * t60_s / (6 * std::numbers::ln10), 2));
    };
    request.snr_db = {};
    const RoomMetrics quiet = measure(rir, 32000.f, RirMeasurement{.direct_delay_s = 0, .request = request});
    ASSERT_TRUE(quiet.sti.has_value());
    EXPECT_NEAR(*quiet.sti, index_of(decayed), 0.01) << t60_s;
    EXPECT_NEAR(*quiet.bands[4].mti, index_of(decayed), 0.01) << t60_s;
    request.snr_db = {snr_db};
    const RoomMetrics noisy = measure(rir, 32000.f, RirMeasurement{.direct_delay_s = 0, .request = request});
    EXPECT_NEAR(*noisy.sti, index_of([&](double hz) { return decayed(hz) / (1 + std::pow(10, -snr_db / 10)); }), 0.01)
        << t60_s << " " << snr_db;
  }
}

TEST(SpeechTransmission, WhatIsMissingHasAReason) {
  ParameterRequest request;
  request.speech = true;
  std::vector<float> rir(8000, 0.f);
  rir[100] = 1.f;
  const RoomMetrics narrow = measure(rir, 8000.f, RirMeasurement{.request = request, .is_green = true});
  EXPECT_FALSE(narrow.sti || narrow.bands[2].mti);
  ASSERT_EQ(narrow.missing.size(), 2u);
  EXPECT_EQ(narrow.missing[1].key, "sti");
  const RoomMetrics plain = measure(rir, 16000.f, RirMeasurement{});
  EXPECT_FALSE(plain.sti || plain.bands[2].mti) << "not asked for";
  EXPECT_NEAR(*measure(rir, 16000.f, RirMeasurement{.request = request}).sti, 1.0, 0.01);
}

// The same of an energy response: direct sound and an exponential, each with its part of the energy.
TEST(SpeechTransmission, OfAnEnergyResponse) {
  AcousticConfig config;
  config.air_absorption = Switch::off;
  config.rir_length_s = 3.f;
  const AcousticScene scene(rooms::shoe1(0.2, 1), config);
  ParameterRequest request;
  request.speech = true;
  for (std::uint32_t draw = 0; draw < 10; ++draw) {
    const double t60_s = drawn_between(6, 2 * draw, 0.4, 1.5), direct = drawn_between(6, 2 * draw + 1, 0, 1);
    EnergyResponse response;
    response.late = make_histogram(scene);
    const double start_s = 0.01, k = 6 * std::numbers::ln10 / t60_s;
    const std::vector<float> sh = {1, 0, 0, 0};
    for (double t = 5e-5; t < 2.9; t += 1e-4)
      response.late.add(static_cast<float>(start_s + t),
                        std::vector<float>(static_cast<std::size_t>(scene.num_bands()), static_cast<float>(k * 1e-4 * std::exp(-k * t))),
                        sh);
    Arrival& first = response.arrivals.emplace_back();
    first.distance_m = static_cast<float>(start_s * scene.speed_of_sound_m_per_s());
    first.amplitude.fill(static_cast<float>(std::sqrt(direct)));
    const double expected =
        index_of([&](double hz) { return std::abs(direct + 1.0 / std::complex(1.0, 2 * std::numbers::pi * hz / k)) / (1 + direct); });
    const RoomMetrics metrics = measure(scene, response, request);
    ASSERT_TRUE(metrics.sti.has_value());
    EXPECT_NEAR(*metrics.sti, expected, 0.005) << t60_s << " " << direct;  // bins of 4 ms
  }
}

}  // namespace
}  // namespace earshot
