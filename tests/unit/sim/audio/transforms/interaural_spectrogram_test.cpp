// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/transforms/interaural_spectrogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr int kSamples = 16000;
const SpectrogramConfig kConfig{};

/// White noise with deviation 1.
std::vector<float> normal_noise(int count, std::uint32_t stream) {
  const RandomStream random(11, Purpose::test, stream);
  std::vector<float> samples(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = random.normal2(static_cast<std::uint32_t>(i))[0];
  return samples;
}

std::vector<float> both(const std::vector<float>& left, const std::vector<float>& right) {
  std::vector<float> sound = left;
  sound.insert(sound.end(), right.begin(), right.end());
  return sound;
}

struct Cells {
  std::vector<float> values;
  [[nodiscard]] float at(int row, int column, int channel) const {
    return values[static_cast<std::size_t>(kInterauralChannels * (row * kConfig.columns() + column) + channel)];
  }
  /// Over the cells of a row that lie wholly inside the window.
  [[nodiscard]] double mean(int row, int channel) const {
    double sum = 0;
    for (int column = 1; column < kConfig.columns() - 2; ++column) sum += static_cast<double>(at(row, column, channel));
    return sum / (kConfig.columns() - 3);
  }
};

Cells analyze(const std::vector<float>& sound) {
  Cells cells{std::vector<float>(static_cast<std::size_t>(kConfig.rows() * kConfig.columns() * kInterauralChannels), 7.f)};
  InterauralHistory history;
  InterauralAnalyzer(kConfig).analyze(sound, 0, history, cells.values);
  return cells;
}

// 1,440 cells of 16 correlated estimates each: the mean power is known to about 1 %, 0.04 dB.
TEST(InterauralSpectrogram, WhiteNoiseHasALevelOfZeroDecibels) {
  for (const double gain_db : {0.0, -30.0, 20.0}) {
    std::vector<float> left = normal_noise(kSamples, 1);
    for (float& sample : left) sample *= static_cast<float>(std::pow(10.0, gain_db / 20));
    const Cells cells = analyze(both(left, left));
    double power = 0;
    int count = 0;
    for (int row = 1; row < kConfig.rows() - 1; ++row)
      for (int column = 1; column < kConfig.columns() - 2; ++column, ++count)
        power += std::pow(10.0, (static_cast<double>(cells.at(row, column, 0) * kInterauralLevelDb + kInterauralFloorDb)) / 10);
    EXPECT_NEAR(10 * std::log10(power / count), gain_db, 0.3);
  }
}

TEST(InterauralSpectrogram, LevelDifferenceIsTheRatioOfTheEars) {
  const std::vector<float> left = normal_noise(kSamples, 2);
  std::vector<float> right = left;
  for (float& sample : right) sample *= 0.5f;
  const Cells cells = analyze(both(left, right));
  for (int row = 0; row < kConfig.rows(); ++row) {
    EXPECT_NEAR(cells.at(row, 10, 1) * kInterauralDifferenceDb, 6.0206, 1e-3);
    EXPECT_NEAR(cells.at(row, 10, 2), 1, 1e-4);
    EXPECT_NEAR(cells.at(row, 10, 3), 0, 1e-4);
  }
}

// The right ear hears what the left one heard d samples before: the phase of bin k is 2 pi k d / 512, here averaged over the four bins of
// a row.  A window of 400 samples that is moved by d keeps 1 - d / 400 of its sound or more.
TEST(InterauralSpectrogram, PhaseDifferenceIsThatOfTheDelay) {
  constexpr int margin = 16;
  const std::vector<float> sound = normal_noise(kSamples + 2 * margin, 3);
  const auto from = [&](int first) { return std::vector<float>(sound.begin() + first, sound.begin() + first + kSamples); };
  for (const int delay : {0, 3, 11, -7}) {
    const Cells cells = analyze(both(from(margin), from(margin - delay)));
    for (const int row : {1, 4, 9, 20}) {
      double cosine = 0, sine = 0;
      for (int k = 4 * row; k < 4 * row + 4; ++k) {
        cosine += 0.25 * std::cos(2 * std::numbers::pi * k * delay / 512.0);
        sine += 0.25 * std::sin(2 * std::numbers::pi * k * delay / 512.0);
      }
      EXPECT_NEAR(cells.mean(row, 2), cosine, 0.06) << delay << " row " << row;
      EXPECT_NEAR(cells.mean(row, 3), sine, 0.06) << delay << " row " << row;  // the wrong sign would be off by up to 2
    }
  }
}

// Of unrelated ears the cross spectrum of a cell is the sum of 16 products, about 4 of them independent (bins and frames overlap), with
// random phases.
TEST(InterauralSpectrogram, EarsWithoutRelationAreNotCoherent) {
  const Cells cells = analyze(both(normal_noise(kSamples, 4), normal_noise(kSamples, 5)));
  double square = 0, mean = 0;
  int count = 0;
  for (int row = 1; row < kConfig.rows() - 1; ++row)
    for (int column = 1; column < kConfig.columns() - 2; ++column, ++count) {
      const double cosine = static_cast<double>(cells.at(row, column, 2)), sine = static_cast<double>(cells.at(row, column, 3));
      square += cosine * cosine + sine * sine;
      mean += cosine;
      ASSERT_LE(cosine * cosine + sine * sine, 1 + 1e-4);
    }
  EXPECT_LT(square / count, 0.4);
  EXPECT_GT(square / count, 0.05);
  EXPECT_LT(std::abs(mean / count), 0.05);
}

TEST(InterauralSpectrogram, SilenceGivesZeros) {
  for (const float value : analyze(std::vector<float>(2 * kSamples, 0.f)).values) ASSERT_EQ(value, 0.f);
}

TEST(InterauralSpectrogram, IsFiniteFromTheFaintestToTheLoudest) {
  for (const double scale : {1e-30, 1e-12, 1e6, 1e12}) {
    std::vector<float> sound = both(normal_noise(kSamples, 6), normal_noise(kSamples, 7));
    for (float& sample : sound) sample *= static_cast<float>(scale);
    for (const float value : analyze(sound).values) ASSERT_TRUE(std::isfinite(value)) << scale;
  }
  // One ear deaf: the difference is that of the sound over the floor.
  const Cells cells = analyze(both(normal_noise(kSamples, 8), std::vector<float>(kSamples, 0.f)));
  EXPECT_NEAR(cells.mean(20, 1), 10, 0.5);  // 100 dB in units of 10 dB
  EXPECT_EQ(cells.at(20, 10, 2), 0.f);
}

TEST(InterauralSpectrogram, HistoryChangesNoBit) {
  const std::array steps{2400, 2400, 0, 160, 15840, 16000, 2400, 2401, 2400, 40000, 2400};
  int total = kSamples;
  for (const int step : steps) total += step;
  const std::vector<float> left = normal_noise(total, 9), right = normal_noise(total, 10);
  InterauralAnalyzer keeping(kConfig), full(kConfig);
  InterauralHistory history;
  std::vector<float> kept(static_cast<std::size_t>(kConfig.rows() * kConfig.columns() * kInterauralChannels)), anew(kept.size());
  std::ptrdiff_t begin = 0;
  std::size_t moved = 0;
  for (std::size_t i = 0; i <= steps.size(); ++i) {
    const std::vector<float> window =
        both({left.begin() + begin, left.begin() + begin + kSamples}, {right.begin() + begin, right.begin() + begin + kSamples});
    keeping.analyze(window, moved, history, kept);
    InterauralHistory empty_history;
    full.analyze(window, 0, empty_history, anew);
    ASSERT_EQ(kept, anew) << "after step " << i;
    if (i == steps.size()) break;
    moved = static_cast<std::size_t>(steps[i]);
    begin += steps[i];
  }
}

}  // namespace
}  // namespace earshot
