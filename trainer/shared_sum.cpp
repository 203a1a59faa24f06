#include "trainer/shared_sum.h"

#include <fmt/format.h>
#include <immintrin.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <ctime>
#include <thread>

#include "sim/base/errors.h"
#include "trainer/sum_order.h"

namespace earshot {
namespace {

constexpr std::size_t kChunk = 256 * 1024;  // bytes; two buffers of two workers stay in a cache of 1 MiB
constexpr int kSpins = 400;                 // some 20 us: shorter than going to sleep and being woken
constexpr std::size_t kBlock = 2048;        // elements that are summed over all workers before the next ones: they stay in the first cache

using Word = std::atomic_ref<std::uint32_t>;
static_assert(Word::is_always_lock_free);

/// Sleeps until the word changes, is woken, or 10 ms are over.
void sleep_on(std::uint32_t& word, std::uint32_t seen) {
  const timespec limit{0, 10'000'000};
  ::syscall(SYS_futex, &word, FUTEX_WAIT, seen, &limit, nullptr, 0);
}

void wake_all(std::uint32_t& word) { ::syscall(SYS_futex, &word, FUTEX_WAKE, 1 << 30, nullptr, nullptr, 0); }

bool reached(std::uint32_t progress, std::uint32_t target) { return static_cast<std::int32_t>(progress - target) >= 0; }

/// target[0, count) = the sum over ranks of the elements [begin, begin + count) of the buffer, in the stated order.  slot_of(rank): where
/// that worker's element `begin` lies.
template <class T, class SlotOf>
void sum_in_order(T* target, std::size_t begin, std::size_t count, std::size_t total, int world_size, const SlotOf& slot_of) {
  const auto world = static_cast<std::size_t>(world_size);
  const bool small = total * sizeof(T) < kSmallSumBytes;
  for (std::size_t segment = 0; segment < (small ? 1 : world); ++segment) {
    const std::size_t first = small ? begin : std::max(begin, segment_start(total, segment, world));
    const std::size_t last = small ? begin + count : std::min(begin + count, segment_start(total, segment + 1, world));
    for (std::size_t block = first; block < last; block += kBlock) {
      const std::size_t offset = block - begin, length = std::min(kBlock, last - block);
      T* const sum = target + offset;
      std::memcpy(sum, slot_of(static_cast<int>(segment)) + offset, length * sizeof(T));
      for (std::size_t k = 1; k < world; ++k) {
        const T* const addend = slot_of(static_cast<int>((segment + k) % world)) + offset;
        for (std::size_t i = 0; i < length; ++i) sum[i] += addend[i];
      }
    }
  }
}

}  // namespace

/// What one worker shows the others, on cache lines of its own.
struct alignas(128) SharedSum::Counter {
  std::uint32_t progress = 0;
  std::uint32_t sleepers = 0;  ///< workers that may be asleep on `progress`
  struct Call {
    std::uint64_t operation = 0, bytes = 0;
  };
  Call calls[2];  ///< by buffer of the call's first chunk: a worker may have begun the next call, never the one after it
};

// Layout: a counter per worker, then two buffers of a slot per worker and one slot of results.
std::size_t SharedSum::bytes_for(int world_size) {
  const auto world = static_cast<std::size_t>(world_size);
  return world * sizeof(Counter) + 2 * (world + 1) * kChunk;
}

SharedSum::SharedSum(std::span<std::byte> memory, WorkerIdentity identity) : memory_(memory), identity_(identity) {
  if (memory.size() != bytes_for(identity.world_size))
    throw RunError("shared memory", fmt::format("{} bytes, {} are due", memory.size(), bytes_for(identity.world_size)));
  // With fewer cores than workers, whoever loops keeps from working the one it waits for.
  if (std::thread::hardware_concurrency() >= static_cast<unsigned>(identity.world_size)) spins_ = kSpins;
}

SharedSum::Counter& SharedSum::counter(int rank) const {
  return reinterpret_cast<Counter*>(memory_.data())[static_cast<std::size_t>(rank)];
}

/// Of the buffer of the present chunk; rank world_size is that of the results.
std::byte* SharedSum::slot(int rank) const {
  const auto world = static_cast<std::size_t>(identity_.world_size);
  const std::size_t buffer = buffer_index();
  return memory_.data() + world * sizeof(Counter) + (buffer * (world + 1) + static_cast<std::size_t>(rank)) * kChunk;
}

/// All that this worker wrote before is there for whoever sees the new progress.
void SharedSum::announce(std::uint32_t progress) {
  Counter& own = counter(identity_.rank);
  Word(own.progress).store(progress);
  if (Word(own.sleepers).load() > 0) wake_all(own.progress);
}

void SharedSum::wait_for_all(std::uint32_t progress, const Check& check) {
  for (int rank = 0; rank < identity_.world_size; ++rank) {
    if (rank == identity_.rank) continue;
    Counter& peer = counter(rank);
    const Word word(peer.progress);
    for (int spin = 0; spin < spins_ && !reached(word.load(std::memory_order_acquire), progress); ++spin) _mm_pause();
    while (!reached(word.load(std::memory_order_acquire), progress)) {
      // The counter is read again after the sleeper is counted: an announcement in between either is seen here or sees the sleeper.
      Word(peer.sleepers).fetch_add(1);
      if (const std::uint32_t seen = word.load(); !reached(seen, progress)) sleep_on(peer.progress, seen);
      Word(peer.sleepers).fetch_sub(1);
      if (!reached(word.load(std::memory_order_acquire), progress)) check(rank);
    }
  }
}

void SharedSum::compare_calls(Operation operation, std::size_t bytes) const {
  for (int rank = 0; rank < identity_.world_size; ++rank) {
    const Counter::Call& peer = counter(rank).calls[buffer_index()];
    if (peer.operation == static_cast<std::uint64_t>(operation) && peer.bytes == bytes) continue;
    throw RunError(fmt::format("worker {}", rank),
                   fmt::format("sums {} bytes where worker {} sums {}, or of another type; do all workers run the same program and config?",
                               peer.bytes, identity_.rank, bytes));
  }
}

template <class T>
void SharedSum::sum_chunks(Operation operation, std::span<T> buffer, const Check& check) {
  const auto [rank, world_size] = identity_;
  const auto world = static_cast<std::size_t>(world_size);
  counter(rank).calls[buffer_index()] = {static_cast<std::uint64_t>(operation), buffer.size_bytes()};
  const bool each_sums_all = world_size == 2 || buffer.size_bytes() < kSmallSumBytes;
  const auto slot_of = [&](int of) { return reinterpret_cast<const T*>(slot(of)); };

  // An empty buffer is one empty chunk: all calls are collective.  A slot is written again two chunks later.  By then every worker has
  // announced the chunk between, which it does only when it has read all it needs of this one.
  std::size_t first = 0;
  do {
    const std::size_t count = std::min(kChunk / sizeof(T), buffer.size() - first);
    T* const out = buffer.data() + first;
    if (count > 0) std::memcpy(slot(rank), out, count * sizeof(T));
    announce(progress_ + (each_sums_all ? 2 : 1));
    wait_for_all(progress_ + (each_sums_all ? 2 : 1), check);
    if (first == 0) compare_calls(operation, buffer.size_bytes());
    if (each_sums_all) {
      sum_in_order(out, first, count, buffer.size(), world_size, slot_of);
    } else {
      T* const results = reinterpret_cast<T*>(slot(world_size));
      const std::size_t begin = segment_start(count, static_cast<std::size_t>(rank), world);
      const std::size_t end = segment_start(count, static_cast<std::size_t>(rank) + 1, world);
      sum_in_order(results + begin, first + begin, end - begin, buffer.size(), world_size, [&](int of) { return slot_of(of) + begin; });
      announce(progress_ + 2);
      wait_for_all(progress_ + 2, check);
      std::memcpy(out, results, count * sizeof(T));
    }
    progress_ += 2;
    first += count;
  } while (first < buffer.size());
}

void SharedSum::sum(Operation operation, std::span<float> buffer, const Check& check) { sum_chunks(operation, buffer, check); }
void SharedSum::sum(Operation operation, std::span<double> buffer, const Check& check) { sum_chunks(operation, buffer, check); }

}  // namespace earshot
