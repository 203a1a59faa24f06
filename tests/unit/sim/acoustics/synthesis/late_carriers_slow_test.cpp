// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/acoustics/synthesis/late_carriers.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

constexpr int kSamples = 16000;
constexpr std::array<double, 7> kCentres = {63, 125, 250, 500, 1000, 2000, 4000};

glm::vec3 some_place(std::uint32_t number) {
  const auto u = RandomStream(5, Purpose::test, number).uniform4(0);
  return {20.f * u[0] - 10.f, 1.f + u[1], 20.f * u[2] - 10.f};
}

/// Spectra of the octaves of a second, without wrap-around.
class OctaveSpectra {
 public:
  OctaveSpectra() : fft_(1 << 15) {}
  using Spectra = std::array<std::vector<std::complex<float>>, kCentres.size()>;
  Spectra of(std::span<const float> samples) {
    Spectra spectra;
    for (std::size_t band = 0; band < kCentres.size(); ++band) {
      spectra[band].resize(static_cast<std::size_t>(fft_.num_bins()));
      fft_.forward(octave_band(samples, kCentres[band], 16000.0), spectra[band]);
    }
    return spectra;
  }
  /// Over all lags.
  std::array<double, kCentres.size()> largest_correlation(const Spectra& a, const Spectra& b) {
    std::array<double, kCentres.size()> result{};
    std::vector<std::complex<float>> product(a[0].size());
    std::vector<float> time(static_cast<std::size_t>(fft_.size()));
    for (std::size_t band = 0; band < kCentres.size(); ++band) {
      double first = 0, second = 0;
      for (std::size_t k = 0; k < product.size(); ++k) {
        product[k] = std::conj(a[band][k]) * b[band][k];
        first += std::norm(a[band][k]), second += std::norm(b[band][k]);
      }
      fft_.inverse(product, time);
      double largest = 0;
      for (const float value : time) largest = std::max(largest, std::abs(static_cast<double>(value)));
      result[band] = largest * fft_.size() / 2 / std::sqrt(first * second);
    }
    return result;
  }

 private:
  RealFft fft_;
};

/// White Gaussian noise under the same decay.
std::vector<float> independent_noise(std::uint32_t number, double decay_s) {
  const RandomStream random(6, Purpose::test, number);
  std::vector<float> samples(kSamples);
  for (int n = 0; n < kSamples; ++n) {
    const auto u = random.uniform4(static_cast<std::uint32_t>(n));
    const double gauss =
        std::sqrt(-2 * std::log(1.0 - static_cast<double>(u[0]))) * std::cos(2 * std::numbers::pi * static_cast<double>(u[1]));
    samples[static_cast<std::size_t>(n)] = static_cast<float>(gauss * std::pow(10.0, -3.0 * n / (16000.0 * decay_s)));
  }
  return samples;
}

// The largest correlation over all lags of places metres apart, octave by octave, beside that of independent Gaussian noise: 300 pairs
// each. Of pairs of independent noise 5 % lie above its quantile of 95 %; standard error of both counts together 1.8 %.  Places share more
// than a third of themselves in 4 % of pairs, by the length of the loops: 5 + 4 + 3 * 1.8 < 15 %.  In the octave of 4 kHz chance is only
// 0.1, and less than that third shows: 25 %.  The mean over pairs: 0.03.
TEST(LateCarriersSlow, PlacesCorrelateAsIndependentNoiseInEveryOctave) {
  constexpr std::uint32_t pairs = 300;
  constexpr double decay_s = 1.0;
  OctaveSpectra octaves;
  std::array<std::vector<double>, kCentres.size()> chance;
  for (std::uint32_t i = 0; i < pairs; ++i) {
    const auto largest =
        octaves.largest_correlation(octaves.of(independent_noise(2 * i, decay_s)), octaves.of(independent_noise(2 * i + 1, decay_s)));
    for (std::size_t band = 0; band < kCentres.size(); ++band) chance[band].push_back(largest[band]);
  }
  for (auto& values : chance) std::ranges::sort(values);
  for (const ChannelLayout layout : {ChannelLayout::mono, ChannelLayout::binaural}) {
    AcousticConfig config = acoustic_preset("fast");
    config.sample_rate_hz = 16000.f;
    config.rir_length_s = 1.f;
    RirSynthesizer synthesizer(make_synthesis_tables(config, BandLayout::octaves(16000.f), layout, nullptr));
    EnergyResponse response = response_with();
    response.late = decay_of(decay_s, 0.02, 7, 0.004f, 1.0);
    const auto at = [&](std::uint32_t number) {
      Rir rir;
      synthesizer.render(response, 0.4, {5, some_place(number)}, rir);
      return octaves.of(rir.channel(0));
    };
    std::array<std::vector<double>, kCentres.size()> seen;
    for (std::uint32_t i = 0; i < pairs; ++i) {
      if (glm::distance(some_place(2 * i), some_place(2 * i + 1)) < 3.f) continue;
      const auto largest = octaves.largest_correlation(at(2 * i), at(2 * i + 1));
      for (std::size_t band = 0; band < kCentres.size(); ++band) seen[band].push_back(largest[band]);
    }
    for (std::size_t band = 0; band < kCentres.size(); ++band) {
      const double quantile = chance[band][pairs * 95 / 100];
      double mean = 0, expected = 0, above = 0;
      for (const double value : seen[band]) mean += value / static_cast<double>(seen[band].size());
      for (const double value : chance[band]) expected += value / pairs;
      for (const double value : seen[band]) above += value > quantile ? 1.0 / static_cast<double>(seen[band].size()) : 0.0;
      EXPECT_NEAR(mean, expected, 0.03) << kCentres[band];
      EXPECT_LT(above, kCentres[band] < 4000 ? 0.15 : 0.25) << kCentres[band];
      std::printf("layout %d, %5.0f Hz: mean %.3f (chance %.3f), above the quantile %.3f (0.05)\n", static_cast<int>(layout),
                  kCentres[band], mean, expected, above);
    }
  }
}

// Octave T20 over places, cells and borders alike, against that of the energy: 1.5 % mono and 2.0 % at an ear within cells
// (synthesis_decay_slow_test.cpp); more where a response passes from one cell to another.  Plain noise has 9 %.
TEST(LateCarriersSlow, OctaveT20OverPlacesStaysNearThatOfTheEnergy) {
  for (const ChannelLayout layout : {ChannelLayout::mono, ChannelLayout::binaural}) {
    double sum = 0;
    int count = 0;
    RirSynthesizer synthesizer(make_synthesis_tables(config_at(16000.f, 1.25f), BandLayout::octaves(16000.f), layout, nullptr));
    for (const double decay_s : {0.2, 0.3, 0.5, 0.8, 1.2}) {
      EnergyResponse response = response_with();
      response.late = decay_of(decay_s, 0.02, 7, 0.004f, 1.25);
      for (std::uint32_t i = 0; i < 40; ++i) {
        Rir rir;
        synthesizer.render(response, 0.9 * i, {7 + i % 4, some_place(3000 + i)}, rir);
        for (std::size_t band = 1; band < kCentres.size(); ++band) {
          const double error =
              t20_s(octave_band(rir.channel(0), 1000.0 * std::pow(10.0, 0.3 * (static_cast<double>(band) - 4.0)), 16000.0), 16000.0) /
                  decay_s -
              1;
          sum += error * error, ++count;
        }
      }
    }
    std::printf("layout %d: %.2f %% rms\n", static_cast<int>(layout), 100 * std::sqrt(sum / count));
    EXPECT_LT(std::sqrt(sum / count), 0.035);
  }
}

}  // namespace
}  // namespace earshot
