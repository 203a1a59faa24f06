// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

namespace earshot {

/// Actions that the oracle needs in each episode of a set, worked out once: it walks the whole way, as long as a hundred steps of an agent.
/// Safe from any threads: two that ask for the same episode at the same time may both work it out, to the same number.
class OracleCounts {
 public:
  explicit OracleCounts(std::size_t num_episodes) : counts_(std::make_unique<std::atomic<std::int32_t>[]>(num_episodes)) {}

  /// count: called where the episode is asked for the first time; at least 1.
  template <class Count>
  int of(std::uint64_t episode, const Count& count) {
    std::atomic<std::int32_t>& known = counts_[episode];
    std::int32_t value = known.load(std::memory_order_relaxed);
    if (value == 0) known.store(value = count(), std::memory_order_relaxed);
    return value;
  }

 private:
  std::unique_ptr<std::atomic<std::int32_t>[]> counts_;  ///< 0: not known
};

}  // namespace earshot
