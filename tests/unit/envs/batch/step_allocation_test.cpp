// SPDX-License-Identifier: Apache-2.0
// What steps take from the process: memory, locks and readings of the clock, counted in the thread that steps, which with one thread is all
// of the batch.
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <time.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <new>
#include <string>

#include "envs/batch/agent_team.h"
#include "envs/batch/batched_env.h"
#include "tests/support/envs/env_fixture.h"

// The sanitizers bring their own operators, and need them.
#ifdef EARSHOT_SANITIZED
#define EARSHOT_COUNTS_ALLOCATIONS 0
#else
#define EARSHOT_COUNTS_ALLOCATIONS 1
#endif

namespace {

// Per thread, so that background threads do not count.
thread_local std::uint64_t allocations = 0, locks = 0, clock_reads = 0;

#if EARSHOT_COUNTS_ALLOCATIONS
void* counted_or_null(std::size_t size, std::size_t alignment) noexcept {
  ++allocations;
  return alignment > alignof(std::max_align_t) ? std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment)
                                               : std::malloc(size > 0 ? size : 1);
}

void* counted(std::size_t size, std::size_t alignment) {
  void* memory = counted_or_null(size, alignment);
  if (!memory) throw std::bad_alloc();
  return memory;
}
#endif

}  // namespace

#if EARSHOT_COUNTS_ALLOCATIONS
void* operator new(std::size_t size) { return counted(size, 0); }
void* operator new[](std::size_t size) { return counted(size, 0); }
void* operator new(std::size_t size, std::align_val_t alignment) { return counted(size, static_cast<std::size_t>(alignment)); }
void* operator new[](std::size_t size, std::align_val_t alignment) { return counted(size, static_cast<std::size_t>(alignment)); }
void* operator new(std::size_t size, const std::nothrow_t&) noexcept { return counted_or_null(size, 0); }
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept { return counted_or_null(size, 0); }
// The pairs match each other; g++ 12 compares them with the operators that they replace.
#pragma GCC diagnostic ignored "-Wmismatched-new-delete"
// std::mutex takes this lock, in whichever library it is; so do the C library's callers of it.
extern "C" int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  using Lock = int (*)(pthread_mutex_t*);
  static const Lock lock = reinterpret_cast<Lock>(dlsym(RTLD_NEXT, "pthread_mutex_lock"));
  ++locks;
  return lock(mutex);
}
// What std::chrono's clocks read.
extern "C" int clock_gettime(clockid_t clock, timespec* time) noexcept {
  using Read = int (*)(clockid_t, timespec*);
  static const Read read = reinterpret_cast<Read>(dlsym(RTLD_NEXT, "clock_gettime"));
  ++clock_reads;
  return read(clock, time);
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
#endif

namespace earshot {
namespace {

TEST(StepAllocation, StepsWithoutAnEpisodeEndAllocateNothing) {
  if (!EARSHOT_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations cannot be counted under a sanitizer";
  EnvConfig config = quick_env_config();
  config.task.max_steps = 500;
  config.threads = 1;
  BatchedEnv env(config, quick_set(1), make_scene_cache(config), 4);
  env.reset();
  const std::vector<std::vector<std::int32_t>> moves = {{1, 2, 3, 1}, {1, 1, 1, 2}, {2, 1, 1, 3}};
  for (std::size_t i = 0; i < 60; ++i) env.step(moves[i % 3]);  // warm: every pose kind has been seen
  const std::uint64_t before = allocations;
  for (std::size_t i = 0; i < 60; ++i) env.step(moves[i % 3]);
  EXPECT_EQ(allocations - before, 0u);
  EXPECT_EQ(env.agent(0).episode_step, 120);
  const auto* probe = new int(1);  // the counter works
  EXPECT_EQ(allocations - before, 1u);
  delete probe;
}

/// Of a roll-out of many episodes, in this thread.
struct Taken {
  std::uint64_t allocations = 0, locks = 0, clock_reads = 0, episodes = 0, steps = 0;
};

/// Runs the same episodes twice with the same actions, and counts in the second run: storage has grown to what these poses need.
Taken count_steady_state(const EnvConfig& config, const std::shared_ptr<const EpisodeSet>& set, int envs, int batches) {
  BatchedEnv env(config, set, make_scene_cache(config), envs);
  Taken taken;
  const int rows = env.num_rows();
  std::vector<std::int32_t> actions(static_cast<std::size_t>(rows));
  for (const bool counts : {false, true}) {
    env.reset();
    const std::uint64_t allocations_before = allocations, locks_before = locks, reads_before = clock_reads;
    for (int i = 0; i < batches; ++i) {
      for (int row = 0; row < rows; ++row) {
        const float u = RandomStream(3, Purpose::test, static_cast<std::uint32_t>(row), static_cast<std::uint32_t>(i)).uniform(0);
        actions[static_cast<std::size_t>(row)] = u < 0.03f ? 0 : u < 0.6f ? 1 : u < 0.8f ? 2 : 3;
      }
      env.step(actions);
      if (counts) taken.episodes += env.finished().size();
    }
    taken.allocations = allocations - allocations_before;
    taken.locks = locks - locks_before;
    taken.clock_reads = clock_reads - reads_before;
  }
  taken.steps = static_cast<std::uint64_t>(rows) * static_cast<std::uint64_t>(batches);
  EXPECT_EQ(env.quarantine_counters().total(), 0u);
  return taken;
}

EnvConfig every_sensor() {
  EnvConfig config = quick_env_config();
  ObservationSpec& spec = config.observation;
  spec.rgb = spec.semantic = spec.normals = spec.depth_noise = true;
  spec.waveform = spec.heard = spec.gps_compass = spec.pose = spec.collision = spec.previous_action = spec.topdown_map = true;
  spec.interaural = spec.oracle_action = spec.goal_state = true;
  spec.pose_noise = {.position_m = 0.1f, .heading_deg = 2.f};
  config.task.actuation_noise = {.forward_m = 0.01f, .turn_deg = 1.f, .veer_deg = 1.f};
  return config;
}

/// The episodes of quick_set() with a second agent on the way between start and goal, which is free in these scenes; it makes no sound:
/// the candidates of a source that moves grow with where it goes.
std::shared_ptr<const EpisodeSet> set_of_pairs() {
  std::vector<Episode> all = quick_set(2)->episodes;
  for (Episode& episode : all)
    episode.other_agents = {{.start_position = episode.start_position + 0.5 * (episode.goal_position - episode.start_position)}};
  return make_set(std::move(all));
}

TEST(StepAllocation, TheCountersCount) {
  if (!EARSHOT_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations cannot be counted under a sanitizer";
  const std::uint64_t allocations_before = allocations, locks_before = locks, reads_before = clock_reads;
  const auto probe = std::make_unique<std::string>(100, 'x');
  std::mutex mutex;
  { const std::scoped_lock lock(mutex); }
  EXPECT_EQ(allocations - allocations_before, 2u);
  EXPECT_EQ(locks - locks_before, 1u);
  EXPECT_GT(std::chrono::steady_clock::now().time_since_epoch().count(), 0);
  EXPECT_EQ(clock_reads - reads_before, 1u);
}

// 10,000 steps of agents, ends of episodes among them: no memory at all, and one lock where an episode begins, in the scene cache, which
// batches share: it hands out the source of the episode, and notes when it was last used.  The clock is read at the six stages of one step
// in sixteen of each env, and twice where an episode begins.  (A line in a log would take memory, a lock and the time.)
TEST(StepAllocation, TenThousandStepsWithEndsTakeNoMemoryAndOneLockPerEpisode) {
  if (!EARSHOT_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations cannot be counted under a sanitizer";
  const Taken taken = count_steady_state(every_sensor(), quick_set(2), 5, 2000);
  EXPECT_EQ(taken.steps, 10'000u);
  EXPECT_GT(taken.episodes, 600u);
  EXPECT_EQ(taken.allocations, 0u);
  EXPECT_EQ(taken.locks, taken.episodes);
  EXPECT_EQ(taken.clock_reads, taken.steps / 16 * 7 + 2 * taken.episodes);
}

// Two agents to an env: they see each other, wait for each other's end and keep apart.
TEST(StepAllocation, TwoAgentsOfAnEnvTakeNoMemory) {
  if (!EARSHOT_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations cannot be counted under a sanitizer";
  EnvConfig config = every_sensor();
  config.agents = 2;
  config.threads = 1;
  const Taken taken = count_steady_state(config, set_of_pairs(), 4, 500);
  EXPECT_EQ(taken.steps, 4000u);
  EXPECT_GT(taken.episodes, 200u);
  EXPECT_EQ(taken.allocations, 0u);
}

// A round of a team takes no memory, neither from the thread that calls nor, as its items say, from those that help.
TEST(StepAllocation, RoundsOfATeamTakeNoMemory) {
  if (!EARSHOT_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations cannot be counted under a sanitizer";
  AgentTeam team(2);
  std::array<std::uint64_t, 8> sums{};
  std::array<std::uint64_t, 3> first{}, last{};
  std::array<bool, 3> seen{};
  const auto start = allocations;
  for (std::uint64_t round = 0; round < 1000; ++round)
    team.run(sums.size(), [&](std::size_t item, std::size_t member) {  // more captures than std::function keeps without memory
      if (!seen[member]) first[member] = allocations;
      seen[member] = true;
      sums[item] += round;
      last[member] = allocations;
    });
  EXPECT_EQ(allocations - start, 0u);
  EXPECT_EQ(first, last);
  for (const std::uint64_t sum : sums) EXPECT_EQ(sum, 499'500u);
}

// Which thread takes which agent is not the same in both runs, so that storage may still grow where a thread meets a pose for the first
// time: seldom, where a copy of the step's body would take memory in each round.
TEST(StepAllocation, AgentsOfAnEnvOnTwoThreadsTakeMemorySeldom) {
  if (!EARSHOT_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations cannot be counted under a sanitizer";
  EnvConfig config = every_sensor();
  config.agents = 2;
  config.threads = 2;
  const Taken taken = count_steady_state(config, set_of_pairs(), 1, 500);
  EXPECT_EQ(taken.steps, 1000u);
  EXPECT_LT(taken.allocations, 50u);
}

// A second lock with prefetching: whether the episode after the next is there already.
TEST(StepAllocation, PrefetchingTakesASecondLock) {
  if (!EARSHOT_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations cannot be counted under a sanitizer";
  EnvConfig config = quick_env_config();
  config.prefetch = true;
  const Taken taken = count_steady_state(config, quick_set(2), 4, 200);
  EXPECT_GT(taken.episodes, 40u);
  EXPECT_EQ(taken.allocations, 0u);
  EXPECT_EQ(taken.locks, 2 * taken.episodes);
}

}  // namespace
}  // namespace earshot
