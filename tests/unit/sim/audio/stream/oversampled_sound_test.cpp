// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/stream/oversampled_sound.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace earshot {
namespace {

constexpr double kLowRateHz = 16000;

/// A sine with a whole number of periods in the loop.
SoundClip sine_loop(std::size_t length, int periods) {
  SoundClip clip{.name = "sine", .sample_rate_hz = static_cast<float>(kLowRateHz), .samples = std::vector<float>(length)};
  for (std::size_t n = 0; n < length; ++n)
    clip.samples[n] = static_cast<float>(std::sin(2.0 * std::numbers::pi * periods * static_cast<double>(n) / static_cast<double>(length)));
  return clip;
}

/// Largest deviation from the sine itself at the places that are read.
double worst_error(std::size_t length, int periods, const StreamPosition& position, double first, double step) {
  const SoundClip clip = sine_loop(length, periods);
  std::vector<float> out(3000);
  OversampledSound(clip).read(position, first, step, out);
  double worst = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double time = static_cast<double>(position.sample + position.clip_offset) + first + static_cast<double>(i) * step;
    const double exact = std::sin(2.0 * std::numbers::pi * periods * time / static_cast<double>(length));
    worst = std::max(worst, std::abs(exact - static_cast<double>(out[i])));
  }
  return worst;
}

// Whole samples are those of the clip but for the window of the reader; between them the sine is a closed form.
TEST(OversampledSound, ReadsASineBetweenItsSamplesUpToSevenKilohertz) {
  for (const double frequency_hz : {100.0, 1000.0, 4000.0, 7000.0, 7800.0}) {
    const auto periods = static_cast<int>(frequency_hz / 4);  // of 4000 samples, 0.25 s
    for (const double first : {0.0, 0.37, -812.61, 5123.5})
      for (const double step : {1.0, 0.9971, 1.0029, 0.93})
        EXPECT_LT(worst_error(4000, periods, {.sample = 12345, .clip_offset = 77}, first, step), 2e-3)
            << frequency_hz << " Hz, " << first << ", " << step;
  }
}

TEST(OversampledSound, KeepsTheLevelToTheLastHundredHertz) {
  // 7.88 of 8 kHz: within 0.5 dB.
  EXPECT_LT(worst_error(4000, 1970, {}, 0.25, 1.0), 1.0 - std::pow(10.0, -0.5 / 20));
}

TEST(OversampledSound, LoopsShorterThanItsFiltersAreLoops) {
  for (const std::size_t length : {1u, 3u, 17u, 255u})
    EXPECT_LT(worst_error(length, length > 2 ? 1 : 0, {.sample = 100000007, .clip_offset = 5}, -3.3, 1.01), 2e-3) << length;
}

TEST(OversampledSound, IsSilentBeforeASoundThatBegins) {
  SoundClip clip{.name = "one", .sample_rate_hz = 16000, .samples = std::vector<float>(50, 1.f)};
  const OversampledSound sound(clip);
  std::vector<float> out(100);
  sound.read({.sample = 30, .clip_offset = 9, .already_playing = false}, -60.5, 1.0, out);
  for (std::size_t i = 0; i < out.size(); ++i) EXPECT_NEAR(out[i], static_cast<double>(i) - 30.5 < 0 ? 0.0 : 1.0, 1e-4) << i;
  sound.read({.sample = 30, .clip_offset = 9, .already_playing = true}, -60.5, 1.0, out);
  for (const float value : out) EXPECT_NEAR(value, 1.0, 1e-4);
}

TEST(OversampledSound, IsSilentOutsideOfItsTime) {
  SoundClip clip{.name = "one", .sample_rate_hz = 16000, .samples = std::vector<float>(50, 1.f)};
  const OversampledSound sound(clip);
  std::vector<float> out(100);
  sound.read({.sample = 30, .clip_offset = 9, .already_playing = false, .begin = 10, .end = 40}, -60.5, 1.5, out);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double place = 30 - 60.5 + 1.5 * static_cast<double>(i);
    EXPECT_NEAR(out[i], place >= 10 && place < 40 ? 1.0 : 0.0, 1e-4) << i;
  }
}

TEST(OversampledSound, PiecesReadOneByOneAreTheWhole) {
  const SoundClip clip = sine_loop(1000, 137);
  const OversampledSound sound(clip);
  std::vector<float> whole(600), piece(200);
  sound.read({}, 5.25, 1.0, whole);
  for (std::size_t p = 0; p < 3; ++p) {
    sound.read({.sample = 200 * p}, 5.25, 1.0, piece);
    for (std::size_t i = 0; i < piece.size(); ++i) EXPECT_EQ(piece[i], whole[200 * p + i]);
  }
}

TEST(OversampledSound, SilenceIsExact) {
  SoundClip clip{.name = "none", .sample_rate_hz = 16000, .samples = std::vector<float>(50)};
  const OversampledSound sound(clip);
  EXPECT_TRUE(sound.silent());
  std::vector<float> out(10, 1.f);
  sound.read({}, 0.5, 1.0, out);
  for (const float value : out) EXPECT_EQ(value, 0.f);
}

}  // namespace
}  // namespace earshot
