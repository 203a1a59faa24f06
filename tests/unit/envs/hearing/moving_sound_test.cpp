// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "envs/hearing/agent_hearing.h"
#include "tests/support/acoustics/band_levels.h"

namespace earshot {
namespace {

using namespace band_levels;

constexpr float kRateHz = 16000;
constexpr int kBlock = 2400, kFade = 800;  // what environments have: 50 ms of each step of 150 ms
constexpr float kEarM = 1.5f;

/// Sound at the left ear of an agent in a hall of which only the direct sound is heard, [samples], at poses 0.15 s apart after the first.
std::vector<float> heard_along(const std::vector<Pose>& poses, const LibrarySound& dry, int glide_paths) {
  AcousticConfig config;
  config.early = config.late = config.diffraction = config.air_absorption = Switch::off;
  config.rir_length_s = 0.1f;
  config.glide_paths = glide_paths;
  SceneCache cache(config, NavmeshConfig{}, "", std::size_t{1} << 30);
  const auto source = cache.source("shoebox:14x4x6@0.5", {1, 0, 3}, kEarM);
  const auto tables =
      make_synthesis_tables(source->scene->acoustics.config(), source->scene->acoustics.bands(), ChannelLayout::binaural, nullptr);
  const StreamConfig stream{.sample_rate_hz = kRateHz, .max_rir_samples = 1600, .max_block_samples = kBlock, .crossfade_samples = kFade};
  HearingEngines engines(tables, stream, SpectrogramConfig{});
  AgentHearing hearing;
  const PlayedSound played{.source = source.get(), .sound = &dry};
  hearing.begin(std::span(&played, 1));
  std::vector<float> sound(2 * kBlock), window(2 * 16000), left;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    hearing.trace(engines, poses[i], kEarM, kBlock);
    EXPECT_TRUE(hearing.synthesize(engines, poses[i].heading_rad));
    if (i == 0) continue;
    EXPECT_TRUE(hearing.convolve(engines, kBlock, sound, window));
    left.insert(left.end(), sound.begin(), sound.begin() + kBlock);
  }
  return left;
}

/// From 4 to 8 m from the source in steps of 0.15 m, looking away from it.
std::vector<Pose> walk_away() {
  std::vector<Pose> poses;
  for (int i = 0; i <= 27; ++i)
    poses.push_back({.position = {5.f + 0.15f * static_cast<float>(i), 0, 3}, .heading_rad = -0.5 * std::numbers::pi});
  return poses;
}

/// The level of a walking agent against agents that stand on its way, per third octave from 100 Hz to 7.9 kHz.
double loss_db(int glide_paths) {
  const LibrarySound dry(white_noise(5 * 16000 + 77, kRateHz, 4));
  const std::vector<Pose> poses = walk_away();
  const std::vector<double> moving = band_powers(heard_along(poses, dry, glide_paths), kRateHz);
  // The same noise at the place in the middle, block by block with the level of each place.
  std::vector<float> still = heard_along(std::vector<Pose>(poses.size(), poses[poses.size() / 2]), dry, glide_paths);
  const double middle_m = 4.0 + 0.15 * static_cast<double>(poses.size() / 2);
  for (std::size_t n = 0; n < still.size(); ++n) still[n] *= static_cast<float>(middle_m / (4.0 + 0.15 * static_cast<double>(n) / kBlock));
  return worst_difference_db(moving, band_powers(still, kRateHz));
}

// The first and the last millisecond of each step beside agents that stand at the pose before and at its own, at the same time of the
// stream: within the millimetre of the way, 0.02 of a period at 1 kHz.  A step late it would be within 0.15 m.
TEST(MovingSound, AStepLeadsFromThePoseBeforeToItsOwn) {
  SoundClip tones{.name = "tones", .sample_rate_hz = kRateHz, .samples = std::vector<float>(16000)};
  for (std::size_t n = 0; n < tones.samples.size(); ++n)
    for (const double hz : {127.0, 311.0, 523.0, 733.0, 997.0})
      tones.samples[n] += static_cast<float>(std::sin(2 * std::numbers::pi * hz * static_cast<double>(n) / static_cast<double>(kRateHz)));
  const LibrarySound dry(tones);
  std::vector<Pose> poses = walk_away();
  poses.resize(6);
  const std::vector<float> walking = heard_along(poses, dry, 3);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    constexpr std::size_t part = 16;
    const auto expect_stands = [&](const Pose& pose, std::size_t from) {
      const std::vector<float> standing = heard_along(std::vector<Pose>(i + 1, pose), dry, 3);
      double difference = 0, power = 0;
      for (std::size_t n = (i - 1) * kBlock; n < i * kBlock; ++n) power += std::pow(static_cast<double>(standing[n]), 2) / kBlock;
      for (std::size_t n = from; n < from + part; ++n) difference += std::pow(static_cast<double>(walking[n] - standing[n]), 2) / part;
      EXPECT_LT(10 * std::log10(difference / power), -20) << "step " << i << " from sample " << from;
    };
    expect_stands(poses[i - 1], (i - 1) * kBlock);
    expect_stands(poses[i], i * kBlock - part);
  }
}

// The same noise on both sides, four seconds of it: what its shift does to the narrowest band is within 0.2 dB.
TEST(MovingSound, AWalkingAgentHearsEveryBandAtItsLevel) { EXPECT_LT(loss_db(3), 0.5); }

// That the test above sees what it is for: two delays cross-faded in 50 of 150 ms.
TEST(MovingSound, WithoutGlidingBandsAreLost) { EXPECT_GT(loss_db(0), 0.7); }

}  // namespace
}  // namespace earshot
