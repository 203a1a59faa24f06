#include "sim/base/denormals.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <thread>

#include "sim/acoustics/tracers/path_tracer.h"
#include "sim/audio/sound_stream.h"
#include "tests/support/env_cases.h"

namespace earshot {
namespace {

/// By its bits: with denormals flushed, comparisons take it for zero.
bool has_denormal_bits(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  return (bits & 0x7F800000u) == 0 && (bits & 0x007FFFFFu) != 0;
}
/// The smallest normal number halved at run time.
float half_of_the_smallest() {
  volatile float smallest = std::numeric_limits<float>::min();
  return smallest * 0.5f;
}

TEST(H39_Denormals, AreFlushedInTheScopeAndKeptAfterIt) {
  ASSERT_FALSE(denormals_are_flushed()) << "a library has set it before main";
  EXPECT_TRUE(has_denormal_bits(half_of_the_smallest()));
  {
    const FlushDenormals flush;
    EXPECT_TRUE(denormals_are_flushed());
    EXPECT_FALSE(has_denormal_bits(half_of_the_smallest()));
    volatile float denormal = std::bit_cast<float>(0x00000123u);  // as an operand: zero
    EXPECT_EQ(denormal * 1e30f, 0.f);
    {
      const FlushDenormals inner;
      EXPECT_TRUE(denormals_are_flushed());
    }
    EXPECT_TRUE(denormals_are_flushed());
  }
  EXPECT_FALSE(denormals_are_flushed());
  EXPECT_TRUE(has_denormal_bits(half_of_the_smallest()));
  std::jthread([] {
    flush_denormals_on_this_thread();
    EXPECT_TRUE(denormals_are_flushed());
  }).join();
  EXPECT_FALSE(denormals_are_flushed());  // a thread's own
}

// Every stage of every env on every thread, and the caller's setting after each call.
TEST(H39_Denormals, AreFlushedInEveryStageAndRestoredForTheCaller) {
  ASSERT_FALSE(denormals_are_flushed()) << "a library has set it before main";
  const tbb::global_control most(tbb::global_control::max_allowed_parallelism, 3);
  EnvConfig config = quick_env_config();
  for (const int threads : {1, 3}) {
    config.threads = threads;
    BatchedEnv env(config, quick_set(1), make_scene_cache(config), 6);
    std::atomic<int> seen{0}, kept{0};
    env.set_tap([&](const StageOutput&, std::span<float>) {
      ++seen;
      if (!denormals_are_flushed()) ++kept;
    });
    env.reset();
    EXPECT_FALSE(denormals_are_flushed());
    for (int step = 0; step < 4; ++step) {
      env.step(std::vector<std::int32_t>(6, 1 + step % 3));
      EXPECT_FALSE(denormals_are_flushed());
    }
    EXPECT_GT(seen, 100);
    EXPECT_EQ(kept, 0) << threads << " threads";
  }
}

/// All values of the late field of a room whose walls leave one part in ten thousand: its tail passes through the denormals.
std::vector<float> dying_field(int threads) {
  AcousticConfig config;
  config.rays = 2000;  // several chunks of work
  config.rir_length_s = 0.5f;
  config.threads = threads;
  const AcousticScene scene(std::make_shared<const Scene>(load_scene("shoebox:4x3x5@0.9999")), config);
  EnergyHistogram histogram = make_histogram(scene);
  trace_late(scene, glm::vec3(1, 1.5f, 1), glm::vec3(3, 1.5f, 4), histogram);
  return {histogram.values().begin(), histogram.values().end()};
}

TEST(H39_Denormals, BitsAreThoseOfAnyThreadAndAnyCallersSetting) {
  const tbb::global_control most(tbb::global_control::max_allowed_parallelism, 3);
  const std::vector<float> one = dying_field(1);
  for (const float value : one) ASSERT_FALSE(has_denormal_bits(value));
  EXPECT_EQ(dying_field(3), one);
  const FlushDenormals flush;
  EXPECT_EQ(dying_field(1), one);
  EXPECT_EQ(dying_field(3), one);
}

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
