#include <gtest/gtest.h>

#include <cstdlib>
#include <new>

#include "envs/batched_env.h"
#include "tests/support/env_fixture.h"

// The sanitizers bring their own operators, and need them.
#ifdef EARSHOT_SANITIZED
#define EARSHOT_COUNTS_ALLOCATIONS 0
#else
#define EARSHOT_COUNTS_ALLOCATIONS 1
#endif

namespace {

// Per thread, so that background threads do not count.
thread_local std::uint64_t allocations = 0;

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
  EXPECT_EQ(env.episode_step(0), 120);
  const auto* probe = new int(1);  // the counter works
  EXPECT_EQ(allocations - before, 1u);
  delete probe;
}

}  // namespace
}  // namespace earshot
