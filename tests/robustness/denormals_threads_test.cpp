// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <atomic>
#include <bit>
#include <limits>
#include <memory>
#include <span>
#include <thread>
#include <vector>

#include "sim/acoustics/tracers/path_tracer.h"
#include "sim/base/denormals.h"
#include "tests/support/denormal_bits.h"
#include "tests/support/envs/env_fixture.h"

// Whether denormals are flushed is a property of each thread: of the workers always, of the caller's as it was.

namespace earshot {
namespace {

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
    env.set_stage_hook([&](const StageOutput&, std::span<float>) {
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
  const std::vector<float> one_thread = dying_field(1);
  for (const float value : one_thread) ASSERT_FALSE(has_denormal_bits(value));
  EXPECT_EQ(dying_field(3), one_thread);
  const FlushDenormals flush;
  EXPECT_EQ(dying_field(1), one_thread);
  EXPECT_EQ(dying_field(3), one_thread);
}

}  // namespace
}  // namespace earshot
