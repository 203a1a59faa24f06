// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/peer_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/log.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

// For a goodbye message to leave, or to arrive after its connection broke; on one host, where the others go on, the shorter one.
constexpr milliseconds kShutdownGrace{300}, kLocalGrace{40};
constexpr milliseconds kLongestWait{100}, kRegroupInterval{10};
constexpr milliseconds kGoodbyes{2000};     // of peers, for a worker that has finished
constexpr milliseconds kBuffersBack{5000};  // for libzmq to drop what it had not sent, once the socket is closed

milliseconds grace_of(const RingConfig& config) {
  return config.survives_loss() && !leaves_host(config.rendezvous) ? kLocalGrace : kShutdownGrace;
}

/// The frame as it is handed out: from a place.
PeerFrame with_place(PeerFrame frame, const MembershipDesk& membership) {
  frame.from = membership.place_of(frame.from);
  return frame;
}

}  // namespace

PeerMesh::PeerMesh(const RingConfig& config)
    : config_(prepared(config)),
      exceptions_at_start_(std::uncaught_exceptions()),
      links_(config_, kShutdownGrace),
      liveness_(Liveness::limits_of(config_, grace_of(config)), links_, config.identity.world_size),
      membership_(config_, links_, liveness_),
      admissions_(config_, links_, membership_) {
  if (config_.incarnation == 0) {
    using enum PeerLinks::Plane;
    zmq::socket_t meeting_socket;
    membership_.start(meet(links_.context(), config_, links_.endpoint(control), links_.endpoint(bulk), links_.security(),
                           config_.survives_loss() ? &meeting_socket : nullptr));
    connect_bulk(identity().right(), identity().left());
    admissions_.listen(std::move(meeting_socket));
    return;
  }
  // Of a worker that joins: asks until the members are about to let it in, and agrees with them on the view in which it is one.
  membership_.start_as_guest(admissions_.ask());
  begin(0);
  try {
    regroup();
  } catch (...) {
    abandon("it has not joined");
    throw;
  }
}

PeerMesh::~PeerMesh() {
  try {
    if (abandoned_) return;
    const bool has_failed = std::uncaught_exceptions() > exceptions_at_start_;
    abandon(!has_failed ? "" : last_change_.empty() ? "an internal error" : last_change_);
  } catch (const std::exception& error) {
    log_error(fmt::format("leaving the run: {}", error.what()));
  }
}

void PeerMesh::link_bulk(int right, int left) {
  if (abandoned_) return;
  if (right == bulk_right_)
    bulk_left_ = left;
  else
    connect_bulk(right, left);
}

/// The own place for `right`: no connection.
void PeerMesh::connect_bulk(int right, int left) {
  bulk_right_ = right;
  bulk_left_ = left;
  links_.disconnect_bulk();
  if (right != identity().rank) links_.connect_bulk(membership_.book().bulk(rank_of(right)), membership_.view().epoch);
}

void PeerMesh::begin(std::uint64_t sequence, bool is_barrier) {
  if (abandoned_) throw RunError("workers", fmt::format("the run has already stopped: {}", *abandoned_));
  last_change_.clear();
  is_barrier_ = is_barrier;
  is_run_over_ = false;
  liveness_.begin(sequence);
}

bool PeerMesh::send_control(int peer, FrameHeader header, std::span<const std::byte> payload) {
  return links_.send(rank_of(peer), membership_.stamped(header), payload);
}

bool PeerMesh::send_bulk(FrameHeader header, std::span<const std::byte> payload) {
  return links_.send_bulk(membership_.stamped(header), payload);
}

std::optional<PeerMesh::Frame> PeerMesh::receive_from(PeerLinks::Plane plane) {
  return links_.receive(plane, [this](PeerSender sender) {
    const PeerLinks::Origin origin = membership_.admit_or_notify(sender);
    if (origin == PeerLinks::Origin::late) ++late_messages_;
    return origin;
  });
}

std::optional<PeerMesh::Frame> PeerMesh::receive_control() {
  const std::uint32_t epoch = membership_.view().epoch;
  const std::uint64_t call = liveness_.call();
  if (!membership_.is_regrouping())
    if (auto kept = links_.kept().take(epoch, call)) return with_place(std::move(*kept), membership_);
  while (auto frame = receive_from(PeerLinks::Plane::control)) {
    const int rank = frame->from;
    liveness_.hear(rank);
    const FrameHeader& header = frame->header;
    if (header.operation == Operation::goodbye) {
      const Goodbye goodbye = decode_goodbye(*frame);
      if (!goodbye.reason.empty() && membership_.heeds(rank))
        throw WorldLost(worker_name(rank), fmt::format("stopped the run: {}", goodbye.reason));
      liveness_.finish(rank, header.sequence);
      const bool is_of_call = header.epoch == epoch && header.sequence == call && membership_.view().has(rank);
      is_run_over_ = is_run_over_ || (goodbye.reason.empty() && is_barrier_ && is_of_call);
    } else if (header.operation == Operation::view) {
      membership_.take_view(*frame);
      if (membership_.is_disrupted() && !is_between_calls_) throw Disruption{};
    } else if (header.operation == Operation::progress) {
      if (header.phase == 0) liveness_.prolong();
    } else if (header.epoch > epoch || (header.epoch == epoch && header.sequence == call + 1)) {
      links_.kept().put(std::move(*frame));
    } else if (header.epoch < epoch || membership_.is_regrouping()) {
      ++late_messages_;
    } else if (header.sequence == call) {
      return with_place(std::move(*frame), membership_);
    } else {  // every call needs something from every worker, so no worker can be two calls ahead, or behind
      throw RunError(worker_name(rank), fmt::format("is at collective call {}, but this worker is at {}", header.sequence, call));
    }
  }
  return std::nullopt;
}

std::optional<PeerMesh::Frame> PeerMesh::receive_bulk() {
  const std::uint32_t epoch = membership_.view().epoch;
  std::optional<Frame> frame;
  if (!early_bulk_.empty() && early_bulk_.front().header.epoch == epoch) {
    frame = std::move(early_bulk_.front());
    early_bulk_.pop_front();
  } else {
    frame = receive_from(PeerLinks::Plane::bulk);
    while (frame && frame->header.epoch < epoch) {
      ++late_messages_;
      frame = receive_from(PeerLinks::Plane::bulk);
    }
    if (frame && frame->header.epoch > epoch) {
      early_bulk_.push_back(std::move(*frame));
      return std::nullopt;
    }
  }
  if (!frame) return std::nullopt;
  if (frame->from != rank_of(left()) || frame->header.sequence != liveness_.call())
    throw RunError(worker_name(frame->from), fmt::format("sends part of collective call {}, but call {} of worker {} is expected",
                                                         frame->header.sequence, liveness_.call(), rank_of(left())));
  return with_place(std::move(*frame), membership_);
}

/// awaited: ranks.
void PeerMesh::check_peers(const std::vector<int>& awaited) {
  membership_.check(awaited);
  if (identity().world_size > 1 && bulk_in_use_ && liveness_.is_bulk_gone()) {
    const int neighbour = rank_of(right());
    if (!liveness_.finished_after(neighbour) && !links_.lost_at(neighbour)) {
      const std::string fault = fmt::format("the connection for gradients to worker {} broke", neighbour);
      if (!config_.survives_loss()) throw WorldLost(worker_name(config_.identity.rank), fault);
      log_warning(fmt::format("worker {}: {}, and is opened again", config_.identity.rank, fault));
      membership_.renew();
    }
  }
  if (membership_.is_disrupted()) throw Disruption{};
  if (PeerLinks::Clock::now() >= liveness_.deadline()) throw liveness_.missed(awaited);
}

void PeerMesh::send_progress(bool waiting) {
  if (!liveness_.is_progress_due()) return;
  liveness_.note_progress_sent();
  FrameHeader header;
  header.operation = Operation::progress;
  header.phase = waiting ? 1 : 0;
  header.total = progress_;
  // A full queue has messages enough for the peer to see; a connection that has gone is seen in the next call.
  for (const int rank : membership_.contacts()) links_.try_send(rank, membership_.stamped(header), {});
}

void PeerMesh::note_progress() {
  ++progress_;
  if (abandoned_) return;
  send_progress(false);
  admissions_.look();
}

int PeerMesh::num_waiting(std::uint64_t next) {
  if (abandoned_) return 0;
  liveness_.set_call(next - 1);  // of call 0, too: the call after this one is `next`, whose messages are kept
  is_between_calls_ = true;
  while (receive_control()) {
  }
  is_between_calls_ = false;
  return links_.kept().num_peers(membership_.view().epoch, next);
}

std::optional<PeerMesh::Change> PeerMesh::regroup() {
  links_.disconnect_bulk();
  if (!links_.wait_for_buffers(kBuffersBack)) throw RunError("ZeroMQ", "does not return its buffers");
  membership_.open_agreement();
  while (true) {
    while (receive_control()) {
    }
    links_.read_monitors();
    // No view can be decided without a proposal of this worker, or by too few.
    if (is_run_over_ && (!membership_.has_proposed() || !membership_.has_quorum())) return std::nullopt;
    membership_.propose();
    send_progress(true);
    admissions_.look();
    if (membership_.is_settled()) break;
    links_.wait_for_control(kRegroupInterval);
  }
  Change change = membership_.adopt();
  const std::uint32_t epoch = membership_.view().epoch;
  while (!early_bulk_.empty() && early_bulk_.front().header.epoch < epoch) early_bulk_.pop_front();
  connect_bulk(identity().right(), identity().left());
  admissions_.follow(change);
  last_change_ = change.lost.empty() ? "the workers had to connect anew" : fmt::format("worker {} was lost", listed(change.lost, ", "));
  return change;
}

void PeerMesh::wait(const Interest& interest) {
  admissions_.look();
  interest_by_rank_ = interest;
  for (auto* peers : {&interest_by_rank_.awaited, &interest_by_rank_.full_control_queues})
    for (int& peer : *peers) peer = rank_of(peer);
  check_peers(interest_by_rank_.awaited);
  send_progress(true);
  auto longest = std::min(liveness_.time_left(), kLongestWait);
  // For its goodbye message; then it counts as dead.
  if (liveness_.awaits_goodbye() || (bulk_in_use_ && links_.bulk_lost_at())) longest = std::min(longest, milliseconds(20));
  links_.poll(interest_by_rank_, longest);
}

void PeerMesh::check(int awaited) {
  admissions_.look();
  send_progress(true);
  links_.read_monitors();
  check_peers({rank_of(awaited)});
}

void PeerMesh::finish_sends() {
  while (!links_.wait_for_buffers(milliseconds(5))) {
    send_progress(true);
    while (auto frame = receive_control())
      throw RunError(worker_name(rank_of(frame->from)),
                     fmt::format("calls {} while this worker is still sending", name_of(frame->header.operation)));
    links_.read_monitors();
    check_peers({rank_of(right())});
  }
}

/// A peer has its connection to this worker's listener, and this worker's messages on another: the end of the one may overtake the others,
/// and would count as a loss.
void PeerMesh::await_goodbyes() {
  const auto deadline = Liveness::Clock::now() + kGoodbyes;
  const auto is_awaited = [this](int rank) {
    return rank != config_.identity.rank && !liveness_.finished_after(rank) && !links_.lost_at(rank);
  };
  while (std::ranges::any_of(members(), is_awaited) && Liveness::Clock::now() < deadline) {
    links_.poll({}, kLongestWait);
    while (const auto frame = receive_from(PeerLinks::Plane::control))
      if (frame->header.operation == Operation::goodbye) liveness_.finish(frame->from, frame->header.sequence);
  }
}

void PeerMesh::abandon(const std::string& reason) {
  if (abandoned_) return;
  abandoned_ = reason.empty() ? "it was closed" : reason;
  if (reason.empty()) {
    links_.extend_linger(PeerLinks::Plane::bulk);
    links_.extend_linger(PeerLinks::Plane::control);
  }
  if (membership_.has_say()) {
    Goodbye goodbye;
    goodbye.reason = reason.substr(0, kMaxReasonBytes);
    const std::string text = encode(goodbye);
    FrameHeader header;
    header.operation = Operation::goodbye;
    header.total = text.size();
    // Whoever it does not reach will see the connection close.
    for (int rank = 0; rank < config_.identity.world_size; ++rank)
      links_.try_send(rank, membership_.stamped(header), std::as_bytes(std::span(text)));
    if (reason.empty()) await_goodbyes();
  }
  admissions_.close();
  links_.close();
}

}  // namespace earshot
