// SPDX-License-Identifier: Apache-2.0
#include "trainer/collective/tree_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/log.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

// For a goodbye message to arrive after its connection broke: longer than in a mesh, as it names the worker that all of the tree are to
// name, and many workers may end at once on few cores.
constexpr milliseconds kGoodbyeGrace{1000};
constexpr milliseconds kLinger{3000};  // for messages to leave; only a neighbour that lives and does not read holds it up
constexpr milliseconds kLongestWait{100}, kLookInterval{100}, kCountInterval{100};
constexpr int kCountsAhead = 100;            // to a neighbour that is away: its queue must not fill (kQueuedControl)
constexpr milliseconds kAnnounceAfter{250};  // who still waits in a call then says so
// Extra time for the neighbours of a missing worker to report it, beyond another timeout.
constexpr milliseconds kPassingOn{5000};

/// A message crosses the tree and returns within half of a call's timeout.
Liveness::Limits tree_limits(const RingConfig& config) {
  Liveness::Limits limits = Liveness::limits_of(config, kGoodbyeGrace);
  const int longest_way = 2 * tree_depth(config.identity.world_size);
  limits.progress_interval = std::min(limits.progress_interval, std::chrono::duration<double>(config.timeout) / (2 * longest_way));
  return limits;
}

}  // namespace

TreeMesh::TreeMesh(const RingConfig& config)
    : config_(prepared(config)),
      exceptions_at_start_(std::uncaught_exceptions()),
      node_(tree_node(config.identity.rank, config.identity.world_size)),
      links_(config_, kLinger),
      liveness_(tree_limits(config), links_, config.identity.world_size) {
  using enum PeerLinks::Plane;
  const PeerTable table = meet(links_.context(), config_, links_.endpoint(control), links_.endpoint(bulk), links_.security());
  links_.set_run_key(hash64(config_.run_id, table.run_key));
  for (const int rank : node_.neighbours()) {
    neighbours_.emplace_back().rank = rank;
    const auto index = static_cast<std::size_t>(rank);
    links_.connect(rank, {table.control_endpoints[index], table.public_keys[index]});
    liveness_.greet(rank);
  }
  const auto next = static_cast<std::size_t>(right());
  links_.connect_bulk({table.bulk_endpoints[next], table.public_keys[next]}, std::nullopt);
}

TreeMesh::~TreeMesh() {
  try {
    if (abandoned_) return;
    abandon(std::uncaught_exceptions() > exceptions_at_start_ ? "an internal error" : "");
  } catch (const std::exception& error) {
    log_error(fmt::format("leaving the run: {}", error.what()));
  }
}

TreeMesh::Neighbour* TreeMesh::neighbour_of(int rank) {
  const auto found = std::ranges::find(neighbours_, rank, &Neighbour::rank);
  return found == neighbours_.end() ? nullptr : &*found;
}

void TreeMesh::begin(std::uint64_t sequence, Operation operation) {
  if (between_calls_) std::rethrow_exception(between_calls_);
  if (abandoned_) throw RunError("workers", fmt::format("the run has already stopped: {}", *abandoned_));
  liveness_.begin(sequence);
  operation_ = operation;
  is_open_ = true;
}

void TreeMesh::end() {
  is_open_ = false;
  liveness_.set_call(liveness_.call() + 1);
}

bool TreeMesh::send_control(int rank, FrameHeader header, std::span<const std::byte> payload) {
  header.sequence = liveness_.call();
  return links_.send(rank, header, payload);
}

bool TreeMesh::send_bulk(FrameHeader header, std::span<const std::byte> payload) {
  header.sequence = liveness_.call();
  return links_.send_bulk(header, payload);
}

std::optional<PeerFrame> TreeMesh::receive_from(PeerLinks::Plane plane) {
  return links_.receive(plane, [&](PeerSender sender) {
    const bool is_known = plane == PeerLinks::Plane::bulk ? sender.rank == left() : neighbour_of(sender.rank) != nullptr;
    return is_known ? PeerLinks::Origin::known : PeerLinks::Origin::unknown;
  });
}

std::optional<PeerFrame> TreeMesh::receive_control() {
  const std::uint64_t call = liveness_.call();
  if (is_open_)
    if (auto kept = links_.kept().take(0, call)) return kept;
  while (auto frame = receive_from(PeerLinks::Plane::control)) {
    Neighbour& from = *neighbour_of(frame->from);
    liveness_.hear(from.rank);
    from.counts_unanswered = 0;
    const FrameHeader& header = frame->header;
    if (header.operation == Operation::goodbye) {
      take_goodbye(*frame);
      liveness_.finish(from.rank, header.sequence);
    } else if (header.operation == Operation::progress) {
      take_progress(from, header);
    } else {
      // Every call needs something from every worker, so that none can be two calls ahead, or behind.
      if (header.sequence != call && !(is_open_ && header.sequence == call + 1))
        throw RunError(worker_name(from.rank), fmt::format("is at collective call {}, but this worker is at {}", header.sequence, call));
      from.begun = header.sequence + 1;
      if (is_open_ && header.sequence == call) return frame;
      links_.kept().put(std::move(*frame));
    }
  }
  return std::nullopt;
}

std::optional<PeerFrame> TreeMesh::receive_bulk() {
  auto frame = receive_from(PeerLinks::Plane::bulk);
  if (frame && frame->header.sequence != liveness_.call())
    throw RunError(worker_name(frame->from),
                   fmt::format("sends part of collective call {}, but call {} is expected", frame->header.sequence, liveness_.call()));
  return frame;
}

void TreeMesh::take_goodbye(const PeerFrame& frame) {
  const Goodbye goodbye = decode_goodbye(frame);
  if (frame.header.step >= static_cast<std::uint32_t>(config_.identity.world_size))
    throw protocol_breach(frame.from, WireError("goodbye message with an invalid rank"));
  if (goodbye.reason.empty()) return;
  stopped_by_ = Stop{static_cast<int>(frame.header.step), goodbye.reason};
  throw WorldLost(worker_name(stopped_by_->rank), fmt::format("stopped the run: {}", goodbye.reason));
}

/// Fields of a message of progress: phase 0 where a worker on that side has got on; sequence, the sender's open or next call; segment, if
/// it is open, its operation + 1; step, how many on that side have begun it.
void TreeMesh::take_progress(Neighbour& from, const FrameHeader& header) {
  from.begun = std::max(from.begun, header.sequence + (header.segment != 0 ? 1 : 0));
  from.heard = {header.sequence, header.step};
  if (header.phase == 0) {
    liveness_.prolong();
    for (Neighbour& other : neighbours_) other.progress_due = other.progress_due || &other != &from;
  }
  if (is_open_ && header.segment != 0 && header.sequence == liveness_.call() &&
      header.segment != static_cast<std::uint32_t>(operation_) + 1)
    throw RunError(worker_name(from.rank),
                   fmt::format("calls {}, but this worker calls {}; start all workers with the same program and config",
                               name_of(static_cast<Operation>(header.segment - 1)), name_of(operation_)));
}

void TreeMesh::check_neighbours() {
  for (const Neighbour& neighbour : neighbours_) {
    if (const auto& num_calls = liveness_.finished_after(neighbour.rank)) {
      // It has done its part of this call or never will; its messages may still be in transit.
      if (is_open_ && *num_calls <= liveness_.call()) throw liveness_.has_left(neighbour.rank);
    } else if (liveness_.is_gone(neighbour.rank)) {
      throw WorldLost(
          worker_name(neighbour.rank),
          fmt::format("stopped responding in or before collective call {}: the process was killed, crashed or hangs", liveness_.call()));
    }
  }
}

void TreeMesh::check_deadline() {
  std::vector<int> missing;
  for (const Neighbour& neighbour : neighbours_) {
    if (liveness_.finished_after(neighbour.rank)) continue;
    if (liveness_.is_silent(neighbour.rank)) throw WorldLost(worker_name(neighbour.rank), liveness_.describe_silence());
    if (neighbour.begun <= liveness_.call()) missing.push_back(neighbour.rank);
  }
  const auto now = Clock::now();
  if (now >= liveness_.deadline() && !missing.empty()) throw liveness_.missed(missing);
  if (now >= liveness_.deadline() + config_.timeout + kPassingOn)
    throw RunError(worker_name(config_.identity.rank),
                   fmt::format("collective call {} did not finish within {} ms, although all neighbours ({}) have started it",
                               liveness_.call(), (now - liveness_.call_began()) / milliseconds(1), listed(node_.neighbours(), ", ")));
}

/// Workers that have begun the open or next call, without those on that neighbour's side.
std::uint32_t TreeMesh::num_begun_beside(const Neighbour& excepted) const {
  std::uint32_t number = is_open_ ? 1 : 0;
  for (const Neighbour& neighbour : neighbours_)
    if (&neighbour != &excepted && neighbour.heard.call == liveness_.call()) number += neighbour.heard.workers;
  return number;
}

/// To all at most every 5 s, or eight times in the time after which this worker would count as lost, and so often that what a worker says
/// crosses the tree in half of a call's timeout; once more in a call that takes longer; where counts are in use, also to those whose count
/// has changed.
void TreeMesh::send_progress() {
  const auto now = Clock::now();
  const std::uint64_t call = liveness_.call();
  const bool announces = is_open_ && announced_ <= call && now - liveness_.call_began() >= kAnnounceAfter;
  const bool due = announces || liveness_.is_progress_due();
  if (!due && (!counting_ || now - counts_sent_at_ < kCountInterval)) return;
  if (due) liveness_.note_progress_sent();
  if (due && is_open_) announced_ = call + 1;
  counts_sent_at_ = now;
  for (Neighbour& neighbour : neighbours_) {
    const Neighbour::Count count{call, num_begun_beside(neighbour)};
    if (!due && (count == neighbour.told || neighbour.counts_unanswered >= kCountsAhead)) continue;
    FrameHeader header;
    header.operation = Operation::progress;
    header.phase = neighbour.progress_due ? 0 : 1;
    header.step = count.workers;
    header.segment = is_open_ ? static_cast<std::uint32_t>(operation_) + 1 : 0;
    header.sequence = call;
    // A full queue has messages enough for it to see; that its connection has gone is seen by its monitor.
    if (links_.try_send(neighbour.rank, header, {}) != PeerLinks::SendResult::sent) continue;
    neighbour.progress_due = false;
    neighbour.told = count;
    ++neighbour.counts_unanswered;
  }
}

/// Between two calls: forwards at once any message that would end the next one.
void TreeMesh::look_around() {
  if (abandoned_) return;
  try {
    receive_control();  // messages of the next call are kept
    links_.read_monitors();
    check_neighbours();
  } catch (const RunError& error) {
    between_calls_ = std::current_exception();
    abandon(error.what());
    return;
  }
  send_progress();
}

void TreeMesh::note_progress() {
  for (Neighbour& neighbour : neighbours_) neighbour.progress_due = true;
  const auto now = Clock::now();
  if (is_open_ || now - looked_at_ < kLookInterval) return;
  looked_at_ = now;
  look_around();
}

int TreeMesh::num_waiting(std::uint64_t next) {
  if (is_open_ || abandoned_) return 0;
  counting_ = true;
  liveness_.set_call(next);
  look_around();
  std::uint32_t number = 0;
  for (const Neighbour& neighbour : neighbours_)
    if (neighbour.heard.call == next) number += neighbour.heard.workers;
  return static_cast<int>(number);
}

void TreeMesh::wait(const PeerInterest& interest) {
  check_neighbours();
  check_deadline();
  // Where nothing is left to be sent the right neighbour may have finished.  Of one that has gone, its neighbours in the tree are the first
  // to know, and say so.
  if (interest.bulk_queue_full && liveness_.is_bulk_gone())
    throw RunError(worker_name(config_.identity.rank), fmt::format("the connection for gradients to worker {} broke", right()));
  send_progress();
  const auto left = liveness_.time_left();
  links_.poll(interest, left.count() > 0 ? std::min(left, kLongestWait) : milliseconds(20));
}

void TreeMesh::finish_sends() {
  while (!links_.wait_for_buffers(milliseconds(5))) {
    send_progress();
    while (auto frame = receive_control())
      throw RunError(worker_name(frame->from),
                     fmt::format("calls {} while this worker is still sending", name_of(frame->header.operation)));
    links_.read_monitors();
    check_neighbours();
    check_deadline();
  }
}

void TreeMesh::abandon(const std::string& reason) {
  if (abandoned_) return;
  abandoned_ = reason.empty() ? "it was closed" : reason;
  if (reason.empty()) links_.extend_linger(PeerLinks::Plane::bulk);
  Goodbye goodbye;
  goodbye.reason = stopped_by_ ? stopped_by_->reason : reason.substr(0, kMaxReasonBytes);
  const std::string text = encode(goodbye);
  std::vector<int> untold = node_.neighbours();
  FrameHeader header;
  header.operation = Operation::goodbye;
  header.sequence = liveness_.call() + (is_open_ ? 1 : 0);
  header.step = static_cast<std::uint32_t>(stopped_by_ ? stopped_by_->rank : config_.identity.rank);
  header.total = text.size();
  // Where the connection has gone the neighbour sees that.
  const auto is_told = [&](int rank) {
    return links_.try_send(rank, header, std::as_bytes(std::span(text))) != PeerLinks::SendResult::queue_full;
  };
  // A full queue is one in the midst of a large call, and empties: who is not told would take this worker for the lost one.
  for (const auto deadline = Clock::now() + kGoodbyeGrace / 2;;) {
    std::erase_if(untold, is_told);
    if (untold.empty() || Clock::now() >= deadline) break;
    std::this_thread::sleep_for(milliseconds(5));
    links_.read_monitors();
  }
  links_.close();
}

}  // namespace earshot
