// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <numeric>
#include <thread>
#include <vector>

#include "envs/batch/env_workers.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

std::vector<std::uint32_t> first_envs(std::size_t count) {
  std::vector<std::uint32_t> envs(count);
  std::iota(envs.begin(), envs.end(), 0u);
  return envs;
}

// Made and destroyed many times, busy or idle: neither a task nor a wake-up is lost.
TEST(EnvWorkers, EveryTaskRunsOnceAndEndsAreClean) {
  for (const int threads : {1, 2, 3, 8})
    for (int round = 0; round < 150; ++round) {
      const std::size_t envs = static_cast<std::size_t>(1 + round % 70);
      std::vector<std::atomic<int>> runs(envs);
      EnvWorkers workers(threads, envs, 0, [&](std::size_t env, std::size_t) { ++runs[env]; });
      if (round % 3 == 1) workers.run_in_background();
      for (int batch = 1; batch <= round % 4; ++batch) {
        workers.submit(first_envs(envs));
        std::vector<int> handed_back(envs, 0);
        workers.finish([&](CompletedEnv completed) {
          EXPECT_FALSE(completed.stalled);
          ++handed_back[completed.env];
        });
        for (std::size_t env = 0; env < envs; ++env) {
          ASSERT_EQ(handed_back[env], 1);
          ASSERT_EQ(runs[env], batch);
        }
      }
    }
}

TEST(EnvWorkers, WhatIsStillUnderWayEndsBeforeTheThreads) {
  std::atomic<int> begun{0}, ended{0};
  {
    EnvWorkers workers(2, 8, 0, [&](std::size_t, std::size_t) {
      ++begun;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      ++ended;
    });
    workers.run_in_background();
    workers.submit(first_envs(8));
    static_cast<void>(workers.next());
  }
  EXPECT_GE(ended, 1);
  EXPECT_EQ(begun, ended);
}

/// Tasks of env 0 wait until they are released; those of the others end at once.
struct Gate {
  std::atomic<bool> open{false};
  std::atomic<int> refused{0};  ///< tasks that were told that they had been given up
  EnvWorkers* workers = nullptr;
  void operator()(std::size_t env, std::size_t worker) {
    EXPECT_TRUE(env != 0 || wait_for_flag(open));
    if (!workers->beat(worker)) ++refused;
  }
};

// More stalls than there are numbers for threads, one after the other: numbers of threads that have ended serve again.
TEST(EnvWorkers, TasksAreGivenUpAgainAndAgain) {
  Gate gate;
  EnvWorkers workers(2, 3, 0.03, [&](std::size_t env, std::size_t worker) { gate(env, worker); });
  gate.workers = &workers;
  for (int round = 1; round <= 80; ++round) {
    gate.open = false;
    workers.submit(first_envs(3));
    int stalled = 0;
    workers.finish([&](CompletedEnv completed) {
      stalled += completed.stalled ? 1 : 0;
      EXPECT_TRUE(completed.env != 0 || completed.stalled);
    });
    EXPECT_GE(stalled, 1);  // on a busy machine the others may seem to hang as well
    EXPECT_FALSE(workers.has_returned(0));
    gate.open = true;
    ASSERT_TRUE(wait_until([&] { return workers.tasks_given_up() == 0; }));
    EXPECT_TRUE(workers.has_returned(0));
    EXPECT_FALSE(workers.has_returned(0));
    for (const std::size_t other : {1u, 2u}) static_cast<void>(workers.has_returned(other));
    EXPECT_GE(gate.refused, round);
  }
}

}  // namespace
}  // namespace earshot
