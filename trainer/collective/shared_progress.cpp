// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/shared_progress.h"

#include <fmt/format.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <atomic>
#include <ctime>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/processor.h"

namespace earshot {
namespace {

constexpr int kSpins = 400;  // some 20 us: shorter than going to sleep and being woken

using Word = std::atomic_ref<std::uint32_t>;
static_assert(Word::is_always_lock_free);

/// Sleeps until the word changes, is woken, or 10 ms are over.
void sleep_on(std::uint32_t& word, std::uint32_t seen) {
  const timespec limit{0, 10'000'000};
  ::syscall(SYS_futex, &word, FUTEX_WAIT, seen, &limit, nullptr, 0);
}

void wake_all(std::uint32_t& word) { ::syscall(SYS_futex, &word, FUTEX_WAKE, 1 << 30, nullptr, nullptr, 0); }

bool reached(std::uint32_t progress, std::uint32_t target) { return static_cast<std::int32_t>(progress - target) >= 0; }

}  // namespace

/// Progress of one worker for the others, on separate cache lines.
struct alignas(128) SharedProgress::Counter {
  std::uint32_t progress = 0;
  std::uint32_t sleepers = 0;  ///< workers that may be asleep on `progress`
  struct Call {
    std::uint64_t operation = 0, bytes = 0;
  };
  Call calls[2];
};

std::size_t SharedProgress::bytes_for(int num_workers) { return static_cast<std::size_t>(num_workers) * sizeof(Counter); }

SharedProgress::SharedProgress(std::span<std::byte> memory, WorkerIdentity identity, int first_rank)
    : memory_(memory), identity_(identity), first_rank_(first_rank) {
  EARSHOT_EXPECT(memory.size() == bytes_for(identity.world_size));
  // With fewer cores than workers, whoever loops keeps from working the one it waits for.
  if (std::thread::hardware_concurrency() >= static_cast<unsigned>(identity.world_size)) spins_ = kSpins;
}

SharedProgress::Counter& SharedProgress::counter(int place) const {
  return reinterpret_cast<Counter*>(memory_.data())[static_cast<std::size_t>(place)];
}

void SharedProgress::announce(std::uint32_t progress) {
  Counter& own_counter = counter(identity_.rank);
  Word(own_counter.progress).store(progress);
  if (Word(own_counter.sleepers).load() > 0) wake_all(own_counter.progress);
}

void SharedProgress::wait_for_all(std::uint32_t progress, const Check& check) {
  for (int place = 0; place < identity_.world_size; ++place)
    if (place != identity_.rank) wait_for(place, progress, check);
}

void SharedProgress::wait_for(int place, std::uint32_t progress, const Check& check) {
  Counter& peer = counter(place);
  const Word word(peer.progress);
  for (int spin = 0; spin < spins_ && !reached(word.load(std::memory_order_acquire), progress); ++spin) relax();
  while (!reached(word.load(std::memory_order_acquire), progress)) {
    // The counter is read again after the sleeper is counted: an announcement in between either is seen here or sees the sleeper.
    Word(peer.sleepers).fetch_add(1);
    if (const std::uint32_t seen = word.load(); !reached(seen, progress)) sleep_on(peer.progress, seen);
    Word(peer.sleepers).fetch_sub(1);
    if (!reached(word.load(std::memory_order_acquire), progress)) check(first_rank_ + place);
  }
}

void SharedProgress::state_call(std::size_t parity, Operation operation, std::size_t bytes) {
  counter(identity_.rank).calls[parity] = {static_cast<std::uint64_t>(operation), bytes};
}

void SharedProgress::compare_calls(std::size_t parity, Operation operation, std::size_t bytes) const {
  for (int place = 0; place < identity_.world_size; ++place) {
    const Counter::Call& peer = counter(place).calls[parity];
    if (peer.operation == static_cast<std::uint64_t>(operation) && peer.bytes == bytes) continue;
    throw RunError(
        worker_name(first_rank_ + place),
        fmt::format("sums {} bytes, but worker {} sums {} bytes or another type; start all workers with the same program and config",
                    peer.bytes, first_rank_ + identity_.rank, bytes));
  }
}

}  // namespace earshot
