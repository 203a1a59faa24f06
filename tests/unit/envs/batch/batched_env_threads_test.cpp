// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <map>
#include <thread>
#include <vector>

#include "envs/batch/batched_env.h"
#include "tests/support/envs/env_fixture.h"
#include "tests/support/envs/env_roll_out.h"

namespace earshot {
namespace {

using namespace roll_outs;

// A sanitizer slows the simulation by a factor of twenty to eighty, and workers that wait without a core of their own slow it by as much
// again (TBB spins): its finds need neither the long run nor a third thread.
#ifdef EARSHOT_SANITIZED
constexpr int kBatchSteps = 6;
constexpr std::array kThreadCounts{2};
#else
constexpr int kBatchSteps = 40;
constexpr std::array kThreadCounts{2, 3};
#endif

TEST(BatchedEnv, ThreadsAndSplitsOfTheBatchChangeNoBit) {
  const tbb::global_control most(tbb::global_control::max_allowed_parallelism, kThreadCounts.back());  // even on a machine with fewer cores
  EnvConfig config = quick_env_config();
  const auto set = quick_set(3);
  const auto scenes = make_scene_cache(config);
  const auto reference = roll_out(config, set, scenes, {6}, kBatchSteps);
  int ends = 0;
  for (const auto& [env, records] : reference)
    for (const Record& r : records) ends += r.flags[0] + r.flags[1];
  EXPECT_GT(ends, kBatchSteps / 4);
  for (const int threads : kThreadCounts) {
    config.threads = threads;
    EXPECT_TRUE(roll_out(config, set, make_scene_cache(config), {6}, kBatchSteps) == reference) << threads << " threads";
  }
  EXPECT_TRUE(roll_out(config, set, scenes, {2, 4}, kBatchSteps) == reference) << "split 2 + 4 on the most threads";
  config.threads = 1;
  config.prefetch = true;
  EXPECT_TRUE(roll_out(config, set, make_scene_cache(config), {1, 5}, kBatchSteps) == reference) << "split 1 + 5, prefetching";
}

TEST(BatchedEnv, HalfBatchesInFlightTogetherChangeNoBit) {
  EnvConfig config = quick_env_config();
  config.prefetch = true;
  const auto set = quick_set(3);
  const auto reference = roll_out(config, set, make_scene_cache(config), {6}, 25);
  const auto scenes = make_scene_cache(config);
  std::map<int, std::vector<Record>> halves[2];
  {
    std::vector<std::jthread> threads;
    for (int half = 0; half < 2; ++half)
      threads.emplace_back([&, half] {
        BatchedEnv env(config, set, scenes, 3, 3 * half, 6);
        env.reset();
        record(env, 3 * half, halves[half]);
        for (int i = 0; i < 25; ++i) {
          step(env, 3 * half, i);
          record(env, 3 * half, halves[half]);
        }
      });
  }
  halves[0].merge(halves[1]);
  EXPECT_TRUE(halves[0] == reference);
}

}  // namespace
}  // namespace earshot
