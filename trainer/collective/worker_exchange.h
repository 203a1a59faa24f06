// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "trainer/collective/collective.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Messages between workers by a library that connects them itself: MPI or Gloo.  It moves bytes; OrderedCollective adds.  One thread uses
/// it.  A lost worker, a worker with another call, and a call without progress for RingConfig::timeout are WorldLost or RunError that name
/// the worker where the library tells.
class WorkerExchange {
 public:
  virtual ~WorkerExchange() = default;
  [[nodiscard]] virtual WorkerIdentity identity() const = 0;
  /// Opens a call: returns once all workers have begun it, with the same operation and number of bytes.
  virtual void begin(Operation operation, std::size_t bytes) = 0;
  /// Part p of `sent` goes to worker p; starts [world_size + 1] are the parts' first bytes.  received: this worker's part of each worker,
  /// by rank, all of one size.
  virtual void all_to_all(std::span<const std::byte> sent, std::span<const std::size_t> starts, std::span<std::byte> received) = 0;
  /// Part p of the buffer comes from worker p, in place.
  virtual void all_gather(std::span<std::byte> buffer, std::span<const std::size_t> starts) = 0;
  /// Rank 0's bytes.
  virtual void broadcast(std::span<std::byte> buffer) = 0;
  /// The library's own sum, in its own order: the yardstick of `earshot bench allreduce`.  Without begin().
  virtual void library_sum(std::span<float> buffer) = 0;
  /// As those of Collective.
  virtual void note_progress() = 0;
  [[nodiscard]] virtual int num_waiting() = 0;
  /// Ends the run: tells the others why.  Later calls throw RunError with that reason.
  virtual void abandon(const std::string& reason) = 0;
};

/// Collective calls over MPI or Gloo with the bits of the ring: a sum is an exchange of segments, a local sum of one segment in the order
/// of sum_order.h, and a gather of the segments, 2 (P - 1) / P of the buffer per worker.  A lost worker is the end of the run.
std::unique_ptr<Collective> make_ordered_collective(std::shared_ptr<WorkerExchange> exchange);

/// Sums by the library's own all-reduce, without a look at the call of others; all else as above.
std::unique_ptr<Collective> make_library_collective(std::shared_ptr<WorkerExchange> exchange);

}  // namespace earshot
