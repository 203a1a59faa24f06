// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/zmq_ring.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "sim/base/errors.h"
#include "sim/base/process/exit_codes.h"
#include "sim/base/text/log.h"
#include "trainer/collective/abandon_on_error.h"
#include "trainer/collective/ring_sum.h"
#include "trainer/collective/sum_order.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
ZmqRing::ZmqRing(const RingConfig& config) : survives_loss_(config.survives_loss()), mesh_(config) {
  if (config.incarnation != 0) return;  // the others compare what they have with it, and share no memory any more
  barrier();
  set_up_shared_memory(config);
}

/// Each says where it is; workers that meet over ipc are on one host.  One that is to send its sums counts as a host of its own.
void ZmqRing::set_up_shared_memory(const RingConfig& config) {
  const WorkerIdentity identity = mesh_.identity();
  std::string host;
  if (config.network.shared_memory) host = config.rendezvous.starts_with("ipc://") ? "ipc" : host_identity();
  const auto layout = contiguous_hosts(all_gather(host));
  if (!layout && identity.rank == 0) log_warning("workers exchange sums by messages: shared memory needs consecutive ranks on each host");
  if (!layout || !layout->shares() || !map_shared_memory(*layout)) return;
  if (layout->num_hosts() > 1) {
    hierarchy_.emplace(mesh_, *layout, std::move(memory_));
    return;
  }
  sums_.emplace(memory_->bytes(), identity);
  mesh_.set_bulk_in_use(false);
}

/// The workers of each host that has several share memory, or none do: a machine without room for it, or containers that do not see each
/// other's processes, go on with messages.
bool ZmqRing::map_shared_memory(const HostLayout& layout) {
  const int rank = mesh_.identity().rank, host = layout.host_of(rank), num_local = layout.num_workers(host);
  const auto leader = static_cast<std::size_t>(layout.first[static_cast<std::size_t>(host)]);
  const std::size_t bytes = layout.num_hosts() == 1 ? SharedSum::bytes_for(num_local) : HierarchicalSum::bytes_for(num_local);
  const bool leads = static_cast<std::size_t>(rank) == leader;
  std::string path, fault;
  const auto attempt = [&](auto&& body) {
    try {
      body();
    } catch (const RunError& error) {
      fault = error.what();
    }
  };
  if (leads && num_local > 1) attempt([&] { path = memory_.emplace(SharedMemory::create(bytes)).path(); });
  path = all_gather(path)[leader];
  if (!leads && !path.empty()) attempt([&] { memory_.emplace(SharedMemory::open(path, bytes)); });
  for (const std::string& reason : all_gather(fault)) {
    if (reason.empty()) continue;
    if (rank == 0) log_warning(fmt::format("workers exchange sums by messages instead of shared memory: {}", reason));
    memory_.reset();
    return false;
  }
  return true;
}

void ZmqRing::mismatch(int place, const FrameHeader& got, Operation operation, std::size_t total) const {
  throw call_mismatch(rank_of(place), got, operation, total);
}

/// Finds those that are left, and throws MembershipChange: the calls of the new view are counted from 0.  Returns where the open call was
/// the last and is complete.
void ZmqRing::regroup() {
  std::optional<PeerMesh::Change> change = mesh_.regroup();
  if (!change) return;
  // A worker that was stopped and goes on may still write there: those that are left send their sums.
  sums_.reset();
  hierarchy_.reset();
  memory_.reset();
  mesh_.set_bulk_in_use(true);
  sequence_ = 0;
  throw MembershipChange(std::move(change->lost), std::move(change->joined));
}

/// Runs one call, and finds those that are left where a worker is lost and the others go on.
template <class Body>
void ZmqRing::collective_call(Body&& body, bool is_barrier) {
  mesh_.begin(sequence_, is_barrier);
  abandon_on_error(mesh_, [&] {
    try {
      body();
      ++sequence_;
    } catch (const PeerMesh::Disruption&) {
      regroup();
    }
  });
}

template <class Sink>
void ZmqRing::exchange(Operation operation, std::span<const std::byte> mine, Sink&& sink) {
  exchange_parts(
      operation, [&](int) { return mine; }, std::forward<Sink>(sink));
}

/// Bytes of every worker to every other in one hop, to each of them its part.  sink(peer, header, bytes) takes each piece, in order per
/// peer.
template <class PartFor, class Sink>
void ZmqRing::exchange_parts(Operation operation, const PartFor& part_for, Sink&& sink) {
  const auto [rank, world_size] = mesh_.identity();
  struct Progress {
    std::size_t sent = 0, received = 0;
    bool sent_all = false, received_all = false;
  };
  std::vector<Progress> progress(static_cast<std::size_t>(world_size));
  progress[static_cast<std::size_t>(rank)] = {0, 0, true, true};
  FrameHeader header;
  header.operation = operation;

  PeerMesh::Interest interest;
  while (true) {
    interest.full_control_queues.clear();
    for (int peer = 0; peer < world_size; ++peer) {
      Progress& p = progress[static_cast<std::size_t>(peer)];
      const std::span<const std::byte> mine = part_for(peer);
      header.total = mine.size();
      while (!p.sent_all) {  // an empty part is one empty message
        header.offset = p.sent;
        const std::size_t length = std::min(kChunkBytes, mine.size() - p.sent);
        if (!mesh_.send_control(peer, header, mine.subspan(p.sent, length))) {
          interest.full_control_queues.push_back(peer);
          break;
        }
        p.sent += length;
        p.sent_all = p.sent == mine.size();
      }
    }
    while (auto frame = mesh_.receive_control()) {
      Progress& p = progress[static_cast<std::size_t>(frame->from)];
      if (frame->header.operation != operation) mismatch(frame->from, frame->header, operation, part_for(frame->from).size());
      if (frame->header.offset != p.received || p.received_all)
        throw RunError(worker_name(rank_of(frame->from)), "sends its part in the wrong order");
      sink(frame->from, frame->header, frame->bytes());
      p.received += frame->payload.size();
      p.received_all = p.received == frame->header.total;
    }
    interest.awaited.clear();
    for (int peer = 0; peer < world_size; ++peer)
      if (!progress[static_cast<std::size_t>(peer)].received_all || !progress[static_cast<std::size_t>(peer)].sent_all)
        interest.awaited.push_back(peer);
    if (interest.awaited.empty() || mesh_.is_run_over()) return;
    mesh_.wait(interest);
  }
}

template <class T>
void ZmqRing::all_reduce(Operation operation, std::span<T> buffer) {
  collective_call([&] {
    if (sums_)
      sums_->sum(operation, buffer, [&](int awaited) {
        while (const auto frame = mesh_.receive_control()) mismatch(frame->from, frame->header, operation, buffer.size_bytes());
        mesh_.check(awaited);
      });
    else if (buffer.size_bytes() < kSmallSumBytes)
      all_reduce_small(operation, buffer);
    else if (hierarchy_)
      hierarchy_->sum(operation, buffer);
    else
      sum_round_ring(mesh_, operation, buffer);
  });
}

template <class T>
void ZmqRing::all_reduce_small(Operation operation, std::span<T> buffer) {
  const auto [rank, world_size] = mesh_.identity();
  const std::size_t bytes = buffer.size_bytes();
  contributions_.resize(bytes * static_cast<std::size_t>(world_size));
  const auto part = [&](int peer) { return std::span(contributions_).subspan(static_cast<std::size_t>(peer) * bytes, bytes); };
  std::ranges::copy(std::as_bytes(buffer), part(rank).begin());
  exchange(operation, part(rank), [&](int peer, const FrameHeader& header, std::span<const std::byte> piece) {
    if (header.total != bytes) mismatch(peer, header, operation, bytes);
    std::ranges::copy(piece, part(peer).begin() + static_cast<std::ptrdiff_t>(header.offset));
  });
  std::ranges::copy(part(0), std::as_writable_bytes(buffer).begin());
  for (int peer = 1; peer < world_size; ++peer) add_to(buffer, part(peer));
}

void ZmqRing::all_reduce_sum(std::span<float> buffer) { all_reduce(Operation::all_reduce_float, buffer); }
void ZmqRing::all_reduce_sum(std::span<double> buffer) { all_reduce(Operation::all_reduce_double, buffer); }

void ZmqRing::broadcast(std::span<std::byte> buffer) {
  collective_call([&] {
    const bool root = mesh_.identity().rank == 0;
    // The others answer with nothing: so rank 0 is never more than one call ahead.
    exchange(Operation::broadcast, root ? std::span<const std::byte>(buffer) : std::span<const std::byte>(),
             [&](int peer, const FrameHeader& header, std::span<const std::byte> piece) {
               if (header.total != (peer == 0 ? buffer.size() : 0)) mismatch(peer, header, Operation::broadcast, buffer.size());
               std::ranges::copy(piece, buffer.begin() + static_cast<std::ptrdiff_t>(header.offset));
             });
  });
}

void ZmqRing::barrier() {
  collective_call(
      [&] {
        exchange(Operation::barrier, {}, [&](int peer, const FrameHeader& header, std::span<const std::byte>) {
          if (header.total != 0) mismatch(peer, header, Operation::barrier, 0);
        });
      },
      true);
}

std::vector<std::string> ZmqRing::all_gather(const std::string& bytes) {
  std::vector<std::string> parts(static_cast<std::size_t>(mesh_.identity().world_size));
  parts[static_cast<std::size_t>(mesh_.identity().rank)] = bytes;
  collective_call([&] {
    if (bytes.size() > kMaxGatherBytes)
      throw RunError("all_gather", fmt::format("{} bytes exceed the limit of {}", bytes.size(), kMaxGatherBytes));
    exchange(Operation::all_gather, std::as_bytes(std::span(bytes)),
             [&](int peer, const FrameHeader& header, std::span<const std::byte> piece) {
               if (header.total > kMaxGatherBytes) mismatch(peer, header, Operation::all_gather, bytes.size());
               parts[static_cast<std::size_t>(peer)].append(reinterpret_cast<const char*>(piece.data()), piece.size());
             });
  });
  return parts;
}

bool ZmqRing::has_joiners() {
  candidates_ = mesh_.admissions().candidates();
  return !candidates_.empty();
}

/// Every member knows who is to join before any proposes a view with them: the barrier stands between.
void ZmqRing::admit() {
  const auto lists = all_gather(std::exchange(candidates_, {}));
  bool has_candidates = false;
  collective_call([&] {
    for (const std::string& list : lists) has_candidates = mesh_.admissions().expect(list) || has_candidates;
    exchange(Operation::barrier, {}, [&](int peer, const FrameHeader& header, std::span<const std::byte>) {
      if (header.total != 0) mismatch(peer, header, Operation::barrier, 0);
    });
    if (has_candidates) mesh_.admissions().invite();
  });
}

std::string ZmqRing::hand_over(int from, const std::vector<int>& to, const std::string& bytes) {
  const int rank = mesh_.identity().rank;
  const auto receives = [&](int place) { return place != from && std::ranges::find(to, place) != to.end(); };
  std::string received;
  collective_call([&] {
    if (bytes.size() > kMaxGatherBytes)
      throw RunError("hand_over", fmt::format("{} bytes exceed the limit of {}", bytes.size(), kMaxGatherBytes));
    const auto part_for = [&](int place) {
      return rank == from && receives(place) ? std::as_bytes(std::span(bytes)) : std::span<const std::byte>();
    };
    exchange_parts(Operation::hand_over, part_for, [&](int peer, const FrameHeader& header, std::span<const std::byte> piece) {
      const bool due = peer == from && receives(rank);
      if (header.total > (due ? kMaxGatherBytes : 0)) mismatch(peer, header, Operation::hand_over, 0);
      received.append(reinterpret_cast<const char*>(piece.data()), piece.size());
    });
  });
  return received;
}

std::unique_ptr<Collective> make_zmq_ring(const RingConfig& config) {
  validate(config);
  if (config.identity.world_size == 1) return make_single_worker();
  try {
    return std::make_unique<ZmqRing>(config);
  } catch (const MembershipChange& change) {
    throw WorldLost("start of the run", change.what());
  } catch (const zmq::error_t& error) {
    throw RunError(fmt::format("rendezvous {}", config.rendezvous), error.what());
  }
}

}  // namespace earshot
