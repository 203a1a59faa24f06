// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "trainer/collective/collective.h"
#include "trainer/collective/tree_mesh.h"

namespace earshot {

/// Collective calls of many workers over a TreeMesh.  Parts go up the tree, each worker's with those of its subtree behind it, so that they
/// come to rank 0 in rank order; the result goes down, each chunk as soon as it is ready.  Rank 0 adds up small sums in rank
/// order; large ones go round the ring: the order of sum_order.h in both.  Sums are always sent, also between workers of one host.
class TreeCollective : public Collective {
 public:
  explicit TreeCollective(const RingConfig& config);
  [[nodiscard]] WorkerIdentity identity() const override { return mesh_.identity(); }
  void all_reduce_sum(std::span<float> buffer) override;
  void all_reduce_sum(std::span<double> buffer) override;
  void broadcast(std::span<std::byte> buffer) override;
  void barrier() override;
  std::vector<std::string> all_gather(const std::string& bytes) override;
  void note_progress() override { mesh_.note_progress(); }
  [[nodiscard]] int num_waiting() override { return mesh_.num_waiting(sequence_); }
  /// Messages of unknown peers that were dropped.
  [[nodiscard]] std::uint64_t unknown_peers() const { return mesh_.unknown_peers(); }
  /// Connections to and from neighbours.
  [[nodiscard]] int num_connections() const { return mesh_.num_connections(); }

 private:
  template <class Body>
  void collective_call(Operation operation, Body&& body);
  template <class T>
  void all_reduce(Operation operation, std::span<T> buffer);
  template <class T>
  void sum_large(Operation operation, std::span<T> buffer);
  template <class Expected>
  void gather(Operation operation, std::span<const std::byte> mine, const Expected& is_expected);
  template <class Expected>
  void scatter(Operation operation, const Expected& is_expected);
  [[nodiscard]] bool is_root() const { return mesh_.node().parent < 0; }

  TreeMesh mesh_;
  std::uint64_t sequence_ = 0;
  std::vector<std::byte> parts_;   ///< of the own subtree, by rank
  std::vector<std::byte> result_;  ///< of the open call
};

}  // namespace earshot
