// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/spectrogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// The definition of docs/reference/formats.md, section 6.3 written out in double, without any of the code under test.
std::vector<double> naive_spectrogram(std::span<const float> sound, const SpectrogramConfig& c) {
  const int bins = c.fft_size / 2 + 1, frames = 1 + c.num_samples / c.hop;
  const int rows = (bins + c.pool - 1) / c.pool, columns = (frames + c.pool - 1) / c.pool;
  std::vector<double> result(static_cast<std::size_t>(rows * columns * 2), 0.0);
  std::vector<double> cosine(c.fft_size), sine(c.fft_size);
  for (int i = 0; i < c.fft_size; ++i) {
    cosine[i] = std::cos(2.0 * std::numbers::pi * i / c.fft_size);
    sine[i] = std::sin(2.0 * std::numbers::pi * i / c.fft_size);
  }
  for (int channel = 0; channel < 2; ++channel) {
    for (int t = 0; t < frames; ++t) {
      for (int k = 0; k < bins; ++k) {
        double re = 0, im = 0;
        for (int i = 0; i < c.window; ++i) {
          const int in_frame = i + (c.fft_size - c.window) / 2;
          const int n = t * c.hop - c.fft_size / 2 + in_frame;
          if (n < 0 || n >= c.num_samples) continue;
          const double hann = std::pow(std::sin(std::numbers::pi * i / c.window), 2);
          const double value = hann * sound[channel * c.num_samples + n];
          re += value * cosine[k * in_frame % c.fft_size];
          im -= value * sine[k * in_frame % c.fft_size];
        }
        result[static_cast<std::size_t>(((k / c.pool) * columns + t / c.pool) * 2 + channel)] += std::hypot(re, im) / (c.pool * c.pool);
      }
    }
  }
  for (double& value : result) value = std::log1p(value);
  return result;
}

std::vector<float> stereo_noise(int num_samples) {
  const RandomStream random(5, Purpose::test);
  std::vector<float> sound(static_cast<std::size_t>(2 * num_samples));
  for (std::size_t i = 0; i < sound.size(); ++i) sound[i] = 2.f * random.uniform(static_cast<std::uint32_t>(i)) - 1.f;
  return sound;
}

TEST(Spectrogram, HasTheShapeThatNetworksExpect) {
  const SpectrogramConfig config;
  EXPECT_EQ(config.num_frames(), 101);
  EXPECT_EQ(config.rows(), 65);
  EXPECT_EQ(config.columns(), 26);
  const SpectrogramConfig at_44k1{.sample_rate_hz = 44100.f, .num_samples = 44100};
  EXPECT_EQ(at_44k1.num_frames(), 276);
  EXPECT_EQ(at_44k1.columns(), 69);
}

TEST(Spectrogram, EqualsTheDefinition) {
  for (const SpectrogramConfig& config :
       {SpectrogramConfig{.num_samples = 4000}, SpectrogramConfig{.num_samples = 1001}, SpectrogramConfig{.num_samples = 100},
        SpectrogramConfig{.num_samples = 900, .fft_size = 256, .hop = 64, .window = 256, .pool = 3}}) {
    const auto sound = stereo_noise(config.num_samples);
    std::vector<float> result(static_cast<std::size_t>(config.rows() * config.columns() * 2));
    SpectrogramAnalyzer(config).analyze(sound, result);
    const auto expected = naive_spectrogram(sound, config);
    ASSERT_EQ(result.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(result[i], expected[i], 2e-6) << i;  // values up to 2.5, float FFT of 512
  }
}

TEST(Spectrogram, ToneLandsInItsRowAndChannel) {
  const SpectrogramConfig config;
  std::vector<float> sound(2 * 16000, 0.f);
  // 2 kHz is bin 64 of 31.25 Hz: row 16.  Right channel only.
  for (int i = 0; i < 16000; ++i) sound[16000 + i] = static_cast<float>(std::sin(0.25 * std::numbers::pi * i));
  std::vector<float> result(65 * 26 * 2);
  SpectrogramAnalyzer(config).analyze(sound, result);
  const auto at = [&](int row, int column, int channel) { return result[(row * 26 + column) * 2 + channel]; };
  for (int column = 1; column < 25; ++column) {  // the first and the last hold the switching clicks
    for (int row = 0; row < 65; ++row) {
      EXPECT_EQ(at(row, column, 0), 0.f);
      if (row < 15 || row > 16) {
        EXPECT_LT(at(row, column, 1), 0.1f * at(16, column, 1));
      }
    }
  }
  // A steady sine of amplitude 1 under a window of sum 200: bins 100; the Hann window of 400 in 512 spreads over about three bins.
  // Bins 64 to 67 of a frame: |W| at 0, 1, 2, 3 bins of 512, W the transform of the window; averaged with weight 1/4.
  double expected = 0;
  for (int k = 0; k < 4; ++k) {
    std::complex<double> sum = 0;
    for (int i = 0; i < 400; ++i)
      sum += std::pow(std::sin(std::numbers::pi * i / 400.0), 2) * std::polar(1.0, -2.0 * std::numbers::pi * k * i / 512.0);
    expected += std::abs(sum) / 2.0 / 4.0;
  }
  EXPECT_NEAR(at(16, 10, 1), std::log1p(expected), 1e-4);
}

TEST(Spectrogram, SilenceGivesZeros) {
  SpectrogramAnalyzer analyzer{SpectrogramConfig{}};
  std::vector<float> result(65 * 26 * 2, 1.f);
  analyzer.analyze(stereo_noise(16000), result);  // leaves scratch dirty
  analyzer.analyze(std::vector<float>(32000, 0.f), result);
  for (const float value : result) ASSERT_EQ(value, 0.f);
}

TEST(Spectrogram, SameSoundGivesTheSameBits) {
  SpectrogramAnalyzer one{SpectrogramConfig{}}, other{SpectrogramConfig{}};
  std::vector<float> first(65 * 26 * 2), second(first.size());
  const auto sound = stereo_noise(16000);
  one.analyze(sound, first);
  one.analyze(sound, first);
  other.analyze(sound, second);
  EXPECT_EQ(first, second);
}

/// A window that moves over a long sound, by `steps` samples each time.
void expect_history_changes_no_bit(const SpectrogramConfig& config, std::span<const int> steps) {
  const auto samples = static_cast<std::size_t>(config.num_samples);
  std::size_t total = samples;
  for (const int step : steps) total += static_cast<std::size_t>(step);
  const auto sound = stereo_noise(static_cast<int>(total));
  SpectrogramAnalyzer keeping(config), full(config);
  SpectrogramHistory history;
  std::vector<float> window(2 * samples), kept(static_cast<std::size_t>(config.rows() * config.columns() * 2)), anew(kept.size());
  std::size_t begin = 0, moved = 0;
  for (std::size_t i = 0;; ++i) {
    for (std::size_t channel = 0; channel < 2; ++channel)
      std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(channel * total + begin), samples,
                  window.begin() + static_cast<std::ptrdiff_t>(channel * samples));
    keeping.analyze(window, moved, history, kept);
    full.analyze(window, anew);
    ASSERT_EQ(kept, anew) << "after step " << i;
    if (i == steps.size()) return;
    moved = static_cast<std::size_t>(steps[i]);
    begin += moved;
  }
}

// Steps of the environments, still windows, steps off the hop, nearly and wholly new windows.
TEST(Spectrogram, HistoryChangesNoBit) {
  expect_history_changes_no_bit({}, std::array{2400, 2400, 0, 4800, 160, 2400, 15840, 16000, 2400, 2401, 2400, 40000, 2400});
  expect_history_changes_no_bit({.num_samples = 1001}, std::array{160, 320, 100, 160, 960, 160});
  expect_history_changes_no_bit({.num_samples = 900, .fft_size = 256, .hop = 64, .window = 256, .pool = 3}, std::array{64, 128, 640, 64});
}

TEST(Spectrogram, ForgottenHistoryIsNotUsed) {
  const auto sound = stereo_noise(16000);
  SpectrogramAnalyzer analyzer{SpectrogramConfig{}};
  SpectrogramHistory history;
  std::vector<float> result(65 * 26 * 2);
  analyzer.analyze(sound, 0, history, result);
  history.forget();
  analyzer.analyze(std::vector<float>(32000, 0.f), 0, history, result);
  for (const float value : result) ASSERT_EQ(value, 0.f);
}

// The logarithm over its whole range, by a sine whose level grows: error of a few units in the last place of values up to 40.
TEST(Spectrogram, LogarithmHoldsFromNearSilenceToTheLoudest) {
  const SpectrogramConfig config{.num_samples = 400};
  for (float level = 1e-12f; level < 1e15f; level *= 7.3f) {
    auto sound = stereo_noise(config.num_samples);
    for (float& value : sound) value *= level;
    std::vector<float> result(static_cast<std::size_t>(config.rows() * config.columns() * 2));
    SpectrogramAnalyzer(config).analyze(sound, result);
    const auto expected = naive_spectrogram(sound, config);
    for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(result[i], expected[i], 1e-6 * expected[i] + 1e-18) << level;
  }
}

TEST(Spectrogram, RefusesNonsense) {
  EXPECT_THROW(SpectrogramAnalyzer(SpectrogramConfig{.num_samples = 0}), InputError);
  EXPECT_THROW(SpectrogramAnalyzer(SpectrogramConfig{.hop = 0}), InputError);
  EXPECT_THROW(SpectrogramAnalyzer(SpectrogramConfig{.window = 600}), InputError);
  EXPECT_THROW(SpectrogramAnalyzer(SpectrogramConfig{.fft_size = 500}), InputError);
}

}  // namespace
}  // namespace earshot
