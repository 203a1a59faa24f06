// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "trainer/collective/collective.h"
#include "trainer/collective/shared_progress.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Sums over the workers of one host through memory that all of them map, 256 KiB at a time so that it stays in caches.  Two workers, and
/// small buffers: each worker copies its chunk there and adds up all of them itself.  More: each adds up one part of the chunk and copies
/// the others' parts.  The order of the additions is that of sum_order.h, so the bits are those of the ring.  Workers wait for each other
/// by SharedProgress.  One thread per worker.
class SharedSum {
 public:
  using Check = SharedProgress::Check;

  static std::size_t bytes_for(int world_size);
  /// memory: bytes_for(world_size) zeroed bytes, the same ones for all workers; must outlive the object.
  SharedSum(std::span<std::byte> memory, WorkerIdentity identity);

  /// As Collective::all_reduce_sum.  `operation` and the size must be those of all workers in this call: else RunError that names one that
  /// differs.
  void sum(Operation operation, std::span<float> buffer, const Check& check);
  void sum(Operation operation, std::span<double> buffer, const Check& check);

 private:
  template <class T>
  void sum_chunks(Operation operation, std::span<T> buffer, const Check& check);
  [[nodiscard]] std::byte* slot(int rank) const;
  [[nodiscard]] std::size_t buffer_index() const { return progress_ / 2 % 2; }

  std::span<std::byte> memory_;  ///< of the slots
  WorkerIdentity identity_;
  SharedProgress workers_;
  std::uint32_t progress_ = 0;  ///< two per chunk, over all calls; may overflow
};

}  // namespace earshot
