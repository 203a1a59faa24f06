// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "trainer/collective/host_layout.h"
#include "trainer/collective/host_ring.h"
#include "trainer/collective/shared_memory.h"
#include "trainer/collective/shared_progress.h"
#include "trainer/net/peer_mesh.h"

namespace earshot {

/// Sums of 64 KiB and more over workers on several hosts.  The first worker of each host, its leader, takes part in a ring between hosts
/// (HostRing); the others give it their addends, and take the result, in memory that the workers of the host share.  The leader adds up for
/// up to four workers, whose copies then run ahead of it; of more workers each adds up a part of every chunk.  The order of additions is
/// that of sum_order.h, so the bits are those of the ring over workers, whatever their placement.
class HierarchicalSum {
 public:
  static std::size_t bytes_for(int num_workers);
  /// memory: bytes_for(workers of this host) bytes that they share; not needed with one worker.  The mesh must outlive the object; its
  /// ring becomes that of the leaders.  Collective.
  HierarchicalSum(PeerMesh& mesh, HostLayout layout, std::optional<SharedMemory> memory);

  /// As Collective::all_reduce_sum, within an open call of the mesh.
  void sum(Operation operation, std::span<float> buffer);
  void sum(Operation operation, std::span<double> buffer);

 private:
  template <class T>
  void sum_chunks(Operation operation, std::span<T> buffer);
  /// One visit: adds to what came, if anything did; the leader's sum goes to `target`, at the others the result of a complete one.
  template <class T>
  void visit_by_leader(const HostRing::Visit& visit, std::span<T> buffer, const zmq::message_t* came, T* target,
                       const SharedProgress::Check& look);
  template <class T>
  void visit_by_all(const HostRing::Visit& visit, std::span<T> buffer, const zmq::message_t* came, T* target,
                    const SharedProgress::Check& look);
  template <class T>
  void add_as_leader(const HostRing::Visit& visit, std::span<T> buffer, const zmq::message_t* came, T* target) const;
  template <class T>
  void add_part(const HostRing::Visit& visit, std::size_t total) const;
  template <class T>
  [[nodiscard]] T* slot_at(int place, const HostRing::Visit& visit, std::size_t element) const {
    return reinterpret_cast<T*>(slot(place)) + (element - visit.first);
  }
  /// body(begin, end, k): the elements of this host's own segment k, counted from its first, within [from, to).
  template <class Body>
  void for_own_segments(std::size_t from, std::size_t to, std::size_t total, Body&& body) const;
  template <class T>
  PeerMesh::Frame next_frame(Operation operation, std::span<T> buffer, const HostRing::Visit& visit);
  bool send_due(Operation operation, std::size_t element_bytes, std::size_t total);
  void check(Operation operation, std::size_t bytes, int awaited);
  [[nodiscard]] std::byte* slot(int place) const;
  [[nodiscard]] bool leads() const { return local_.rank == 0; }
  [[nodiscard]] std::size_t parity() const { return progress_ / 2 % 2; }

  PeerMesh& mesh_;
  HostLayout layout_;
  int host_;
  WorkerIdentity local_;  ///< place among the workers of this host
  std::optional<SharedMemory> memory_;
  std::optional<SharedProgress> workers_;  ///< in memory_
  /// Message that the leader forwards: lent to the mesh until the end of the call.
  struct Due {
    HostRing::Visit visit;
    const std::byte* data = nullptr;
  };
  std::deque<Due> due_;
  std::vector<std::byte> begun_;  ///< sums of the host's own part that lack this worker's addends, which stay in its buffer
  std::uint32_t progress_ = 0;    ///< two per visit, over all calls; may overflow
};

}  // namespace earshot
