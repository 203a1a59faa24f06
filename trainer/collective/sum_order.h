// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace earshot {

/// The order in which a sum over workers adds, the same whatever connects them, so that bits do not depend on it: buffers below
/// kSmallSumBytes in rank order; larger ones in world_size segments, segment k in the order k, k + 1, ..., k + P - 1 (mod P), which is what
/// a ring does (docs/explanation/ppo.md, section 6.1).
inline constexpr std::size_t kSmallSumBytes = 64 * 1024;  // below this, latency counts and not bandwidth

/// Elements that are summed over all workers before the next ones: they stay in the first cache.
inline constexpr std::size_t kSumBlock = 2048;

/// First element of a segment of a buffer of `count` elements; for segment world_size, the end.  Whole cache lines but for the last.
inline std::size_t segment_start(std::size_t count, std::size_t segment, std::size_t world_size) {
  constexpr std::size_t kAlignment = 16;
  return segment >= world_size ? count : count * segment / world_size / kAlignment * kAlignment;
}

/// target[0, count) = the sum over ranks of the elements [begin, begin + count) of the buffer, in the stated order.  slot_of(rank): where
/// that worker's element `begin` lies.
template <class T, class SlotOf>
void sum_in_order(T* target, std::size_t begin, std::size_t count, std::size_t total, int world_size, const SlotOf& slot_of) {
  const auto world = static_cast<std::size_t>(world_size);
  const bool small = total * sizeof(T) < kSmallSumBytes;
  for (std::size_t segment = 0; segment < (small ? 1 : world); ++segment) {
    const std::size_t first = small ? begin : std::max(begin, segment_start(total, segment, world));
    const std::size_t last = small ? begin + count : std::min(begin + count, segment_start(total, segment + 1, world));
    for (std::size_t block = first; block < last; block += kSumBlock) {
      const std::size_t offset = block - begin, length = std::min(kSumBlock, last - block);
      T* const sum = target + offset;
      std::memcpy(sum, slot_of(static_cast<int>(segment)) + offset, length * sizeof(T));
      for (std::size_t k = 1; k < world; ++k) {
        const T* const addend = slot_of(static_cast<int>((segment + k) % world)) + offset;
        for (std::size_t i = 0; i < length; ++i) sum[i] += addend[i];
      }
    }
  }
}

}  // namespace earshot
