// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "trainer/collective/collective.h"
#include "trainer/collective/hierarchical_sum.h"
#include "trainer/collective/host_layout.h"
#include "trainer/collective/shared_memory.h"
#include "trainer/collective/shared_sum.h"
#include "trainer/net/peer_mesh.h"

namespace earshot {

/// Collective calls over a PeerMesh.  Small buffers, and all that is not a sum, go from every worker to every other in one hop and are
/// summed in rank order. Large sums go round the ring: reduce-scatter, then all-gather (Patarasuk and Yuan 2009), 2 (P - 1) / P of the
/// buffer per worker.  Segment k is summed in the order k, k + 1, ..., k + P - 1 (mod P): the same on every worker and in every run, but
/// another one for another P.  Workers of one host add up in memory that they share instead, and with workers of other hosts by way of one
/// worker per host (HierarchicalSum), in the same order.
class ZmqRing : public Collective {
 public:
  explicit ZmqRing(const RingConfig& config);
  [[nodiscard]] WorkerIdentity identity() const override { return mesh_.identity(); }
  [[nodiscard]] std::vector<int> members() const override { return mesh_.members(); }
  [[nodiscard]] bool survives_loss() const override { return survives_loss_; }
  void note_progress() override { mesh_.note_progress(); }
  [[nodiscard]] int num_waiting() override { return mesh_.num_waiting(sequence_); }
  void all_reduce_sum(std::span<float> buffer) override;
  void all_reduce_sum(std::span<double> buffer) override;
  void broadcast(std::span<std::byte> buffer) override;
  void barrier() override;
  std::vector<std::string> all_gather(const std::string& bytes) override;
  void brief(const std::string& text) override { mesh_.admissions().brief(text); }
  [[nodiscard]] bool has_joiners() override;
  void admit() override;
  std::string hand_over(int from, const std::vector<int>& to, const std::string& bytes) override;
  void confirm_join() override { mesh_.admissions().confirm(); }
  /// Whether all sums go through memory that all workers share.
  [[nodiscard]] bool shares_memory() const { return sums_.has_value(); }
  /// Whether large sums go through memory that the workers of each host share.
  [[nodiscard]] bool shares_memory_per_host() const { return hierarchy_.has_value(); }
  /// Messages of unknown peers that were dropped.
  [[nodiscard]] std::uint64_t unknown_peers() const { return mesh_.unknown_peers(); }
  /// Messages of earlier views that were dropped.
  [[nodiscard]] std::uint64_t late_messages() const { return mesh_.late_messages(); }

 private:
  template <class Body>
  void collective_call(Body&& body, bool is_barrier = false);
  void regroup();
  [[noreturn]] void mismatch(int place, const FrameHeader& got, Operation operation, std::size_t total) const;
  [[nodiscard]] int rank_of(int place) const { return mesh_.members()[static_cast<std::size_t>(place)]; }
  template <class Sink>
  void exchange(Operation operation, std::span<const std::byte> mine, Sink&& sink);
  template <class PartFor, class Sink>
  void exchange_parts(Operation operation, const PartFor& part_for, Sink&& sink);
  template <class T>
  void all_reduce(Operation operation, std::span<T> buffer);
  template <class T>
  void all_reduce_small(Operation operation, std::span<T> buffer);

  void set_up_shared_memory(const RingConfig& config);
  bool map_shared_memory(const HostLayout& layout);

  bool survives_loss_;
  PeerMesh mesh_;
  std::optional<SharedMemory> memory_;
  std::optional<SharedSum> sums_;             ///< in memory_
  std::optional<HierarchicalSum> hierarchy_;  ///< owns its memory
  std::uint64_t sequence_ = 0;
  std::string candidates_;                ///< candidates that admit() announces
  std::vector<std::byte> contributions_;  ///< [world_size, bytes] of a small sum
};

}  // namespace earshot
