// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/tree_collective.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <optional>

#include "sim/base/errors.h"
#include "trainer/collective/abandon_on_error.h"
#include "trainer/collective/ring_sum.h"
#include "trainer/collective/sum_order.h"

namespace earshot {
namespace {

/// Sends bytes to one neighbour in chunks.
struct Outgoing {
  int rank = 0;
  std::size_t sent = 0;
  bool done = false;

  /// False when its queue is full.  The available part of `total` bytes may grow.
  bool send(TreeMesh& mesh, FrameHeader header, std::span<const std::byte> payload, std::size_t total) {
    while (!done && (sent < payload.size() || payload.size() == total)) {  // nothing is one empty message
      header.offset = sent;
      header.total = total;
      const std::size_t length = std::min(kChunkBytes, payload.size() - sent);
      if (!mesh.send_control(rank, header, payload.subspan(sent, length))) return false;
      sent += length;
      done = sent == total;
    }
    return true;
  }
};

/// Bytes of one neighbour, in chunks.
struct Incoming {
  std::vector<std::byte>& bytes;
  bool done = false;
  std::size_t total = 0;

  void take(const PeerFrame& frame, std::uint8_t phase) {
    const FrameHeader& header = frame.header;
    if (done || header.phase != phase || header.offset != bytes.size() || (header.offset > 0 && header.total != total))
      throw RunError(worker_name(frame.from), "sends its part in the wrong order");
    total = header.total;
    bytes.insert(bytes.end(), frame.bytes().begin(), frame.bytes().end());
    done = bytes.size() == total;
  }
};

}  // namespace

TreeCollective::TreeCollective(const RingConfig& config) : mesh_(config) { barrier(); }

template <class Body>
void TreeCollective::collective_call(Operation operation, Body&& body) {
  mesh_.begin(sequence_, operation);
  abandon_on_error(mesh_, [&] {
    body();
    mesh_.end();
    ++sequence_;
  });
}

/// Up: parts_ becomes this worker's part and those of its subtree, which go to the parent.  is_expected(subtree, header): whether a child's
/// message can be one of this call.
template <class Expected>
void TreeCollective::gather(Operation operation, std::span<const std::byte> mine, const Expected& is_expected) {
  const TreeNode& node = mesh_.node();
  std::vector<std::vector<std::byte>> of_children(node.children.size());
  std::vector<Incoming> incoming;
  for (auto& bytes : of_children) incoming.push_back({bytes});
  std::optional<Outgoing> up;
  FrameHeader header;
  header.operation = operation;
  PeerInterest interest;
  while (true) {
    if (!up && std::ranges::all_of(incoming, &Incoming::done)) {
      parts_.assign(mine.begin(), mine.end());
      for (const auto& bytes : of_children) parts_.insert(parts_.end(), bytes.begin(), bytes.end());
      if (is_root()) return;
      up.emplace(Outgoing{node.parent});
    }
    interest.full_control_queues.clear();
    if (up && !up->send(mesh_, header, parts_, parts_.size())) interest.full_control_queues.push_back(node.parent);
    if (up && up->done) return;
    while (const auto frame = mesh_.receive_control()) {
      if (frame->header.operation != operation) throw call_mismatch(frame->from, frame->header, operation, mine.size());
      const auto child = std::ranges::find(node.children, frame->from, &TreeNode::Subtree::first);
      if (child == node.children.end()) throw RunError(worker_name(frame->from), "sends a result before all parts have arrived");
      if (!is_expected(*child, frame->header)) {
        FrameHeader per_worker = frame->header;
        per_worker.total /= static_cast<std::uint64_t>(child->size());
        throw call_mismatch(frame->from, per_worker, operation, mine.size());
      }
      incoming[static_cast<std::size_t>(child - node.children.begin())].take(*frame, 0);
    }
    if (!up && std::ranges::all_of(incoming, &Incoming::done)) continue;
    mesh_.wait(interest);
  }
}

/// Down: rank 0's result_ comes to all.  is_expected(header): whether the parent's message can be one of this call.
template <class Expected>
void TreeCollective::scatter(Operation operation, const Expected& is_expected) {
  const TreeNode& node = mesh_.node();
  FrameHeader header;
  header.operation = operation;
  header.phase = 1;
  std::vector<Outgoing> down;
  for (const auto& child : node.children) down.push_back({child.first});
  if (!is_root()) result_.clear();
  Incoming incoming{result_, is_root(), result_.size()};
  bool began = is_root();
  PeerInterest interest;
  while (true) {
    interest.full_control_queues.clear();
    for (Outgoing& child : down)
      if (began && !child.send(mesh_, header, result_, incoming.total)) interest.full_control_queues.push_back(child.rank);
    if (incoming.done && std::ranges::all_of(down, &Outgoing::done)) return;
    bool came = false;
    while (const auto frame = mesh_.receive_control()) {
      if (frame->header.operation != operation || !is_expected(frame->header))
        throw call_mismatch(frame->from, frame->header, operation, parts_.size());
      if (frame->from != node.parent) throw RunError(worker_name(frame->from), "sends its part in the wrong order");
      incoming.take(*frame, 1);
      began = came = true;
    }
    if (!came) mesh_.wait(interest);
  }
}

/// A worker may be many steps of the ring ahead of the next one.  It stays until that one has all of its messages: where a connection ends
/// while the listener's queue is full, libzmq 4.3.4 drops what the kernel still holds.
template <class T>
void TreeCollective::sum_large(Operation operation, std::span<T> buffer) {
  collective_call(operation, [&] { sum_round_ring(mesh_, operation, buffer); });
  barrier();
}

template <class T>
void TreeCollective::all_reduce(Operation operation, std::span<T> buffer) {
  const std::size_t bytes = buffer.size_bytes();
  if (bytes >= kSmallSumBytes) {
    sum_large(operation, buffer);
    return;
  }
  collective_call(operation, [&] {
    gather(operation, std::as_bytes(buffer), [&](const TreeNode::Subtree& child, const FrameHeader& header) {
      return header.total == bytes * static_cast<std::size_t>(child.size());
    });
    if (is_root()) {
      const auto part = [&](int rank) { return std::span(parts_).subspan(static_cast<std::size_t>(rank) * bytes, bytes); };
      for (int rank = 1; rank < identity().world_size; ++rank) add_to(buffer, part(rank));
      result_.assign(std::as_bytes(buffer).begin(), std::as_bytes(buffer).end());
    }
    scatter(operation, [&](const FrameHeader& header) { return header.total == bytes; });
    std::ranges::copy(result_, std::as_writable_bytes(buffer).begin());
  });
}

void TreeCollective::all_reduce_sum(std::span<float> buffer) { all_reduce(Operation::all_reduce_float, buffer); }
void TreeCollective::all_reduce_sum(std::span<double> buffer) { all_reduce(Operation::all_reduce_double, buffer); }

void TreeCollective::broadcast(std::span<std::byte> buffer) {
  collective_call(Operation::broadcast, [&] {
    // Rank 0 waits until all have begun, so that no worker is more than one call ahead of another.
    gather(Operation::broadcast, {}, [](const TreeNode::Subtree&, const FrameHeader& header) { return header.total == 0; });
    if (is_root()) result_.assign(buffer.begin(), buffer.end());
    scatter(Operation::broadcast, [&](const FrameHeader& header) { return header.total == buffer.size(); });
    std::ranges::copy(result_, buffer.begin());
  });
}

void TreeCollective::barrier() {
  collective_call(Operation::barrier, [&] {
    gather(Operation::barrier, {}, [](const TreeNode::Subtree&, const FrameHeader& header) { return header.total == 0; });
    if (is_root()) result_.clear();
    scatter(Operation::barrier, [](const FrameHeader& header) { return header.total == 0; });
  });
}

/// Each part travels behind its length.
std::vector<std::string> TreeCollective::all_gather(const std::string& bytes) {
  std::vector<std::string> texts;
  collective_call(Operation::all_gather, [&] {
    if (bytes.size() > kMaxGatherBytes)
      throw RunError("all_gather", fmt::format("{} bytes exceed the limit of {}", bytes.size(), kMaxGatherBytes));
    const std::uint64_t length = bytes.size();
    std::vector<std::byte> mine(sizeof(length) + bytes.size());
    std::memcpy(mine.data(), &length, sizeof(length));
    std::memcpy(mine.data() + sizeof(length), bytes.data(), bytes.size());
    const auto bound = [](int workers) { return static_cast<std::size_t>(workers) * (sizeof(length) + kMaxGatherBytes); };
    gather(Operation::all_gather, mine,
           [&](const TreeNode::Subtree& child, const FrameHeader& header) { return header.total <= bound(child.size()); });
    if (is_root()) std::swap(result_, parts_);
    scatter(Operation::all_gather, [&](const FrameHeader& header) { return header.total <= bound(identity().world_size); });
    for (std::span<const std::byte> rest = result_; !rest.empty();) {
      std::uint64_t size = 0;
      if (rest.size() >= sizeof(size)) std::memcpy(&size, rest.data(), sizeof(size));
      if (rest.size() < sizeof(size) || size > rest.size() - sizeof(size)) throw RunError("all_gather", "received invalid lengths");
      texts.emplace_back(reinterpret_cast<const char*>(rest.data() + sizeof(size)), size);
      rest = rest.subspan(sizeof(size) + size);
    }
    if (texts.size() != static_cast<std::size_t>(identity().world_size))
      throw RunError("all_gather", fmt::format("received {} parts from {} workers", texts.size(), identity().world_size));
  });
  return texts;
}

}  // namespace earshot
