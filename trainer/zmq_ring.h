#pragma once

#include <optional>
#include <vector>

#include "trainer/collective.h"
#include "trainer/peer_mesh.h"
#include "trainer/shared_memory.h"
#include "trainer/shared_sum.h"

namespace earshot {

/// Collective calls over a PeerMesh.  Small buffers, and all that is not a sum, go from every worker to every other in one hop and are
/// summed in rank order. Large sums go round the ring: reduce-scatter, then all-gather (Patarasuk and Yuan 2009), 2 (P - 1) / P of the
/// buffer per worker.  Segment k is summed in the order k, k + 1, ..., k + P - 1 (mod P): the same on every worker and in every run, but
/// another one for another P.  Workers that meet over ipc add up in memory that they share instead, in the same order.
class ZmqRing : public Collective {
 public:
  explicit ZmqRing(const RingConfig& config);
  [[nodiscard]] WorkerIdentity identity() const override { return mesh_.identity(); }
  void all_reduce_sum(std::span<float> buffer) override;
  void all_reduce_sum(std::span<double> buffer) override;
  void broadcast(std::span<std::byte> buffer) override;
  void barrier() override;
  std::vector<std::string> all_gather(const std::string& bytes) override;
  /// Whether sums go through shared memory.
  [[nodiscard]] bool shares_memory() const { return sums_.has_value(); }
  /// Messages of unknown peers that were dropped.
  [[nodiscard]] std::uint64_t unknown_peers() const { return mesh_.unknown_peers(); }

 private:
  template <class Body>
  void collective_call(Body&& body);
  template <class Sink>
  void exchange(Operation operation, std::span<const std::byte> mine, Sink&& sink);
  template <class T>
  void all_reduce(Operation operation, std::span<T> buffer);
  template <class T>
  void all_reduce_small(Operation operation, std::span<T> buffer);
  template <class T>
  void all_reduce_ring(Operation operation, std::span<T> buffer);

  void map_shared_memory();

  PeerMesh mesh_;
  std::optional<SharedMemory> memory_;
  std::optional<SharedSum> sums_;  ///< in memory_
  std::uint64_t sequence_ = 0;
  std::vector<std::byte> contributions_;  ///< [world_size, bytes] of a small sum
};

}  // namespace earshot
