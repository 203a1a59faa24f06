// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

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

}  // namespace earshot
