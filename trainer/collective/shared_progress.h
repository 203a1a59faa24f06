// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "trainer/collective/collective.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Counters in memory that the workers of one host share.  Every worker has one that it alone advances; the others wait for it, first in a
/// short loop, then asleep in the kernel (futex).  The counter of a dead worker stays unchanged, which only `check` detects.  One thread
/// per worker.
class SharedProgress {
 public:
  /// Called about every 10 ms while this worker waits for worker `awaited`; ends the wait by an exception.
  using Check = std::function<void(int awaited)>;

  static std::size_t bytes_for(int num_workers);
  /// memory: bytes_for(num_workers) zeroed bytes, the same ones for all workers; must outlive the object.  Workers are named by their
  /// ranks: first_rank is that of the first one.  identity: place among the workers that share.
  SharedProgress(std::span<std::byte> memory, WorkerIdentity identity, int first_rank = 0);

  /// Earlier writes of this worker are visible to readers of the new progress.  Progress may overflow.
  void announce(std::uint32_t progress);
  void wait_for_all(std::uint32_t progress, const Check& check);
  void wait_for(int place, std::uint32_t progress, const Check& check);

  /// States the call of this worker, before its first announcement; two may be there at a time (`parity` 0 or 1), as a worker may have
  /// begun
  /// the next call, never the one after it.
  void state_call(std::size_t parity, Operation operation, std::size_t bytes);
  /// Throws RunError that names a worker whose call differs.
  void compare_calls(std::size_t parity, Operation operation, std::size_t bytes) const;

 private:
  struct Counter;
  [[nodiscard]] Counter& counter(int place) const;

  std::span<std::byte> memory_;
  WorkerIdentity identity_;
  int first_rank_, spins_ = 0;
};

}  // namespace earshot
