// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/shared_sum.h"

#include <algorithm>
#include <cstring>

#include "sim/base/errors.h"
#include "trainer/collective/sum_order.h"

namespace earshot {
namespace {

constexpr std::size_t kSharedChunk = 256 * 1024;  // bytes; two buffers of two workers stay in a cache of 1 MiB

}  // namespace

// Layout: a counter per worker, then two buffers of a slot per worker and one slot of results.
std::size_t SharedSum::bytes_for(int world_size) {
  const auto world = static_cast<std::size_t>(world_size);
  return SharedProgress::bytes_for(world_size) + 2 * (world + 1) * kSharedChunk;
}

SharedSum::SharedSum(std::span<std::byte> memory, WorkerIdentity identity)
    : identity_(identity), workers_(memory.first(std::min(memory.size(), SharedProgress::bytes_for(identity.world_size))), identity) {
  EARSHOT_EXPECT(memory.size() == bytes_for(identity.world_size));
  memory_ = memory.subspan(SharedProgress::bytes_for(identity.world_size));
}

/// Of the buffer of the present chunk; rank world_size is that of the results.
std::byte* SharedSum::slot(int rank) const {
  const auto world = static_cast<std::size_t>(identity_.world_size);
  const std::size_t buffer = buffer_index();
  return memory_.data() + (buffer * (world + 1) + static_cast<std::size_t>(rank)) * kSharedChunk;
}

template <class T>
void SharedSum::sum_chunks(Operation operation, std::span<T> buffer, const Check& check) {
  const auto [rank, world_size] = identity_;
  const auto world = static_cast<std::size_t>(world_size);
  workers_.state_call(buffer_index(), operation, buffer.size_bytes());
  const bool every_rank_sums = world_size == 2 || buffer.size_bytes() < kSmallSumBytes;
  const auto slot_of = [&](int rank_of_slot) { return reinterpret_cast<const T*>(slot(rank_of_slot)); };

  // An empty buffer is one empty chunk: all calls are collective.  A slot is written again two chunks later.  By then every worker has
  // announced the chunk between, which it does only when it has read all it needs of this one.
  std::size_t first = 0;
  do {
    const std::size_t count = std::min(kSharedChunk / sizeof(T), buffer.size() - first);
    T* const out = buffer.data() + first;
    if (count > 0) std::memcpy(slot(rank), out, count * sizeof(T));
    workers_.announce(progress_ + (every_rank_sums ? 2 : 1));
    workers_.wait_for_all(progress_ + (every_rank_sums ? 2 : 1), check);
    if (first == 0) workers_.compare_calls(buffer_index(), operation, buffer.size_bytes());
    if (every_rank_sums) {
      sum_in_order(out, first, count, buffer.size(), world_size, slot_of);
    } else {
      T* const results = reinterpret_cast<T*>(slot(world_size));
      const std::size_t begin = segment_start(count, static_cast<std::size_t>(rank), world);
      const std::size_t end = segment_start(count, static_cast<std::size_t>(rank) + 1, world);
      sum_in_order(results + begin, first + begin, end - begin, buffer.size(), world_size,
                   [&](int rank_of_slot) { return slot_of(rank_of_slot) + begin; });
      workers_.announce(progress_ + 2);
      workers_.wait_for_all(progress_ + 2, check);
      std::memcpy(out, results, count * sizeof(T));
    }
    progress_ += 2;
    first += count;
  } while (first < buffer.size());
}

void SharedSum::sum(Operation operation, std::span<float> buffer, const Check& check) { sum_chunks(operation, buffer, check); }
void SharedSum::sum(Operation operation, std::span<double> buffer, const Check& check) { sum_chunks(operation, buffer, check); }

}  // namespace earshot
