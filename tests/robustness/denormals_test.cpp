// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "sim/audio/stream/sound_stream.h"
#include "tests/support/denormal_bits.h"

namespace earshot {
namespace {

// A sound and a room that both die away through the denormals, then silence: nothing that is heard, and no spectrum that is kept, is one.
TEST(H39_Denormals, ASilentTailLeavesNone) {
  constexpr int kBlock = 1200, kTaps = 4000;
  SoundClip clip{.name = "dying", .sample_rate_hz = 16000.f, .samples = std::vector<float>(160000, 0.f)};
  for (std::size_t i = 0; i < 16000; ++i)
    clip.samples[i] = static_cast<float>((i % 3 == 0 ? 1.0 : -0.5) * std::exp(-static_cast<double>(i) / 150.0));
  std::vector<float> rir(kTaps);
  for (std::size_t i = 0; i < rir.size(); ++i)
    rir[i] = static_cast<float>((i % 5 == 0 ? -1.0 : 0.7) * std::exp(-static_cast<double>(i) / 40.0));
  ASSERT_TRUE(std::ranges::any_of(clip.samples, has_denormal_bits));
  ASSERT_TRUE(std::ranges::any_of(rir, has_denormal_bits));
  const StreamConfig config{.max_rir_samples = kTaps, .max_block_samples = kBlock, .crossfade_samples = 400};
  StreamConvolver convolver(config, 1);
  std::vector<float> sound(kBlock);
  double last = 1;
  for (StreamPosition position{.already_playing = false}; position.sample < 150000; position.sample += kBlock) {
    const std::vector<float> before(rir.rbegin(), rir.rend());
    convolver.convolve(clip, position, rir, before, kTaps, kBlock, sound);
    for (const float value : sound) ASSERT_FALSE(has_denormal_bits(value)) << position.sample;
    last = 0;
    for (const float value : sound) last = std::max(last, std::abs(static_cast<double>(value)));
  }
  EXPECT_EQ(last, 0.0);  // ten seconds of silence end in silence
}

TEST(H39_Denormals, TheHelpersTellThemApart) {
  EXPECT_TRUE(has_denormal_bits(std::bit_cast<float>(1u)));
  EXPECT_FALSE(has_denormal_bits(0.f));
  EXPECT_FALSE(has_denormal_bits(-0.f));
  EXPECT_FALSE(has_denormal_bits(std::numeric_limits<float>::min()));
}

}  // namespace
}  // namespace earshot
