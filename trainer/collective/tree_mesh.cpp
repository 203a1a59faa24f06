#include "trainer/collective/tree_mesh.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <exception>
#include <thread>

#include "sim/base/errors.h"
#include "sim/base/files.h"

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
// What the rest leave to the neighbours of a worker that is missing, beyond another timeout, to say so.
constexpr milliseconds kPassingOn{5000};

std::string worker(int rank) { return fmt::format("worker {}", rank); }

}  // namespace

TreeMesh::TreeMesh(const RingConfig& config)
    : config_(config),
      exceptions_at_start_(std::uncaught_exceptions()),
      node_(tree_node(config.identity.rank, config.identity.world_size)) {
  validate(config_);
  config_ = resolved(config_);
  security_ = LinkSecurity(config_);
  gate_ = security_.open_gate(context_);
  control_in_ = open_listener(context_, security_, kQueuedControl);
  bulk_in_ = open_listener(context_, security_, kQueuedMessages);
  const std::string control_endpoint = bind_listener(control_in_, config_, "control"),
                    bulk_endpoint = bind_listener(bulk_in_, config_, "bulk");
  const PeerTable table = meet(context_, config_, control_endpoint, bulk_endpoint, security_);
  run_key_ = hash64(config_.run_id, table.run_key);
  const int longest_way = 2 * tree_depth(config_.identity.world_size);
  progress_interval_s_ =
      std::min({5.0, config_.network.progress_timeout_s / 8, std::chrono::duration<double>(config_.timeout).count() / (2 * longest_way)});
  neighbours_.reserve(node_.neighbours().size());
  for (const int rank : node_.neighbours()) {
    neighbours_.emplace_back().rank = rank;
    connect(neighbours_.back(), table);
  }
  connect_bulk(table);
}

TreeMesh::~TreeMesh() {
  try {
    if (abandoned_) return;
    abandon(std::uncaught_exceptions() > exceptions_at_start_ ? "an error of its own" : "");
  } catch (const std::exception& error) {
    spdlog::error("leaving the run: {}", error.what());
  }
}

int TreeMesh::right() const { return (config_.identity.rank + 1) % config_.identity.world_size; }
int TreeMesh::left() const { return (config_.identity.rank + config_.identity.world_size - 1) % config_.identity.world_size; }

void TreeMesh::connect(Neighbour& neighbour, const PeerTable& table) {
  const auto rank = static_cast<std::size_t>(neighbour.rank);
  neighbour.control = open_dialer(context_, routing_id_of(run_key_, config_.identity.rank, 0), kLinger);
  security_.secure_dialer(neighbour.control, table.public_keys[rank]);
  const int interval_ms = static_cast<int>(config_.heartbeat.count());
  neighbour.control.set(zmq::sockopt::heartbeat_ivl, interval_ms);
  neighbour.control.set(zmq::sockopt::heartbeat_timeout, 4 * interval_ms);
  neighbour.monitor = monitor_of(context_, neighbour.control, fmt::format("inproc://neighbour-{}", neighbour.rank));
  neighbour.control.connect(table.control_endpoints[rank]);
  neighbour.heard_at = Clock::now();
}

void TreeMesh::connect_bulk(const PeerTable& table) {
  const auto rank = static_cast<std::size_t>(right());
  // Its payloads are lent: they must come back when the caller leaves.
  bulk_out_ = open_dialer(context_, routing_id_of(run_key_, config_.identity.rank, 0), milliseconds(0));
  security_.secure_dialer(bulk_out_, table.public_keys[rank]);
  bulk_monitor_ = monitor_of(context_, bulk_out_, "inproc://bulk");
  bulk_out_.connect(table.bulk_endpoints[rank]);
}

TreeMesh::Neighbour* TreeMesh::neighbour_of(int rank) {
  const auto found = std::ranges::find(neighbours_, rank, &Neighbour::rank);
  return found == neighbours_.end() ? nullptr : &*found;
}

void TreeMesh::begin(std::uint64_t sequence, Operation operation) {
  if (between_calls_) throw RunError(*between_calls_);
  if (abandoned_) throw RunError("workers", fmt::format("the run was stopped before: {}", *abandoned_));
  call_ = sequence;
  operation_ = operation;
  is_open_ = true;
  call_began_ = Clock::now();
  deadline_ = call_began_ + config_.timeout;
}

void TreeMesh::end() {
  is_open_ = false;
  ++call_;
}

bool TreeMesh::send_control(int rank, FrameHeader header, std::span<const std::byte> payload) {
  Neighbour* const to = neighbour_of(rank);
  EARSHOT_EXPECT(to != nullptr);
  header.run_key = run_key_;
  header.sequence = call_;
  header.length = payload.size();
  return send_message(to->control, header, zmq::message_t(payload.data(), payload.size()));
}

bool TreeMesh::send_bulk(FrameHeader header, std::span<const std::byte> payload) {
  header.run_key = run_key_;
  header.sequence = call_;
  header.length = payload.size();
  return send_message(bulk_out_, header, lent_message(payload, lent_buffers_));
}

std::optional<PeerFrame> TreeMesh::receive_from(zmq::socket_t& socket, bool bulk) {
  for (int unknown = 0; unknown < kUnknownAtOnce; ++unknown) {
    std::optional<ReceivedMessage> message = receive_message(socket);
    if (!message) return std::nullopt;
    const PeerSender sender = sender_of(message->parts[0].to_string(), run_key_, config_.identity);
    if (bulk ? sender.rank == left() : neighbour_of(sender.rank) != nullptr) return frame_of(std::move(*message), sender.rank, run_key_);
    if (++unknown_peers_ == 1) spdlog::warn("worker {} ignores messages of an unknown peer on its port", config_.identity.rank);
  }
  return std::nullopt;  // a flood: first see whether the neighbours are alive
}

std::optional<PeerFrame> TreeMesh::receive_control() {
  for (Neighbour& neighbour : neighbours_) {
    if (!is_open_ || neighbour.early.empty() || neighbour.early.front().header.sequence != call_) continue;
    PeerFrame frame = std::move(neighbour.early.front());
    neighbour.early.pop_front();
    return frame;
  }
  while (auto frame = receive_from(control_in_, false)) {
    Neighbour& from = *neighbour_of(frame->from);
    from.heard_at = Clock::now();
    from.counts_unanswered = 0;
    const FrameHeader& header = frame->header;
    if (header.operation == Operation::goodbye) {
      take_goodbye(from, *frame);
      from.finished_after = header.sequence;
    } else if (header.operation == Operation::progress) {
      take_progress(from, header);
    } else {
      // Every call needs something from every worker, so that none can be two calls ahead, or behind.
      if (header.sequence != call_ && !(is_open_ && header.sequence == call_ + 1))
        throw RunError(worker(from.rank), fmt::format("is at collective call {} where this worker is at {}", header.sequence, call_));
      from.begun = header.sequence + 1;
      if (is_open_ && header.sequence == call_) return frame;
      from.early.push_back(std::move(*frame));
    }
  }
  return std::nullopt;
}

std::optional<PeerFrame> TreeMesh::receive_bulk() {
  auto frame = receive_from(bulk_in_, true);
  if (frame && frame->header.sequence != call_)
    throw RunError(worker(frame->from),
                   fmt::format("sends part of collective call {} where call {} is due", frame->header.sequence, call_));
  return frame;
}

void TreeMesh::take_goodbye(const Neighbour& from, const PeerFrame& frame) {
  Goodbye goodbye;
  try {
    goodbye = decode<Goodbye>(frame.payload.to_string_view());
    if (frame.header.step >= static_cast<std::uint32_t>(config_.identity.world_size)) throw WireError("a goodbye of no worker");
  } catch (const WireError& error) {
    throw RunError(worker(from.rank), fmt::format("breaks the protocol: {}", error.what()));
  }
  if (goodbye.reason.empty()) return;
  stopped_by_ = Stop{static_cast<int>(frame.header.step), goodbye.reason};
  throw RunError(worker(stopped_by_->rank), fmt::format("stopped the run: {}", goodbye.reason));
}

/// Fields of a message of progress: phase 0 where a worker on that side has got on; sequence, the sender's open or next call; segment, if
/// it is open, its operation + 1; step, how many on that side have begun it.
void TreeMesh::take_progress(Neighbour& from, const FrameHeader& header) {
  from.begun = std::max(from.begun, header.sequence + (header.segment != 0 ? 1 : 0));
  from.heard = {header.sequence, header.step};
  if (header.phase == 0) {
    deadline_ = Clock::now() + config_.timeout;
    for (Neighbour& other : neighbours_) other.progress_due = other.progress_due || &other != &from;
  }
  if (is_open_ && header.segment != 0 && header.sequence == call_ && header.segment != static_cast<std::uint32_t>(operation_) + 1)
    throw RunError(worker(from.rank), fmt::format("calls {} where this worker calls {}; do all workers run the same program and config?",
                                                  name_of(static_cast<Operation>(header.segment - 1)), name_of(operation_)));
}

void TreeMesh::read_monitors() {
  const auto now = Clock::now();
  for (Neighbour& neighbour : neighbours_)
    if (neighbour.monitor && has_ended(neighbour.monitor) && !neighbour.lost_at) neighbour.lost_at = now;
  if (bulk_monitor_ && has_ended(bulk_monitor_) && !bulk_lost_at_) bulk_lost_at_ = now;
}

void TreeMesh::check_neighbours() {
  const auto now = Clock::now();
  for (const Neighbour& neighbour : neighbours_) {
    if (neighbour.finished_after) {
      // It has done its part of this call or it never will; what it did send may still be on its way.
      if (is_open_ && *neighbour.finished_after <= call_)
        throw RunError(worker(neighbour.rank),
                       fmt::format("has left the run after {} collective calls, this worker makes another", *neighbour.finished_after));
    } else if (neighbour.lost_at && now - *neighbour.lost_at >= kGoodbyeGrace) {
      throw RunError(worker(neighbour.rank),
                     fmt::format("has gone in or before collective call {}: it was killed, crashed, or hangs", call_));
    }
  }
}

void TreeMesh::check_deadline() {
  const auto now = Clock::now();
  const milliseconds patience(static_cast<std::int64_t>(1000 * config_.network.progress_timeout_s));
  std::vector<int> missing;
  for (const Neighbour& neighbour : neighbours_) {
    if (neighbour.finished_after) continue;
    if (now - std::max(neighbour.heard_at, call_began_) >= patience)
      throw RunError(
          worker(neighbour.rank),
          fmt::format("has made no progress for {} ms, in or before collective call {}: it hangs in a loop", patience.count(), call_));
    if (neighbour.begun <= call_) missing.push_back(neighbour.rank);
  }
  if (now >= deadline_ && !missing.empty())
    throw RunError(fmt::format("worker {}", fmt::join(missing, ", ")),
                   fmt::format("did not take part in collective call {} within {} ms", call_, config_.timeout.count()));
  if (now >= deadline_ + config_.timeout + kPassingOn)
    throw RunError(worker(config_.identity.rank),
                   fmt::format("collective call {} did not end within {} ms, though all neighbours ({}) have begun it", call_,
                               (now - call_began_) / milliseconds(1), fmt::join(node_.neighbours(), ", ")));
}

/// Workers that have begun the open or next call, without those on that neighbour's side.
std::uint32_t TreeMesh::num_begun_beside(const Neighbour& excepted) const {
  std::uint32_t number = is_open_ ? 1 : 0;
  for (const Neighbour& neighbour : neighbours_)
    if (&neighbour != &excepted && neighbour.heard.call == call_) number += neighbour.heard.workers;
  return number;
}

/// To all at most every 5 s, or eight times in the time after which this worker would count as lost, and so often that what a worker says
/// crosses the tree in half of a call's timeout; once more in a call that takes longer; where counts are in use, also to those whose count
/// has changed.
void TreeMesh::send_progress() {
  const auto now = Clock::now();
  const bool announces = is_open_ && announced_ <= call_ && now - call_began_ >= kAnnounceAfter;
  const bool due = announces || std::chrono::duration<double>(now - progress_sent_at_).count() >= progress_interval_s_;
  if (!due && (!counting_ || now - counts_sent_at_ < kCountInterval)) return;
  if (due) progress_sent_at_ = now;
  if (due && is_open_) announced_ = call_ + 1;
  counts_sent_at_ = now;
  for (Neighbour& neighbour : neighbours_) {
    if (neighbour.lost_at) continue;
    const Neighbour::Count count{call_, num_begun_beside(neighbour)};
    if (!due && (count == neighbour.told || neighbour.counts_unanswered >= kCountsAhead)) continue;
    FrameHeader header;
    header.operation = Operation::progress;
    header.phase = neighbour.progress_due ? 0 : 1;
    header.step = count.workers;
    header.segment = is_open_ ? static_cast<std::uint32_t>(operation_) + 1 : 0;
    try {
      if (!send_control(neighbour.rank, header, {})) continue;  // a full queue has messages enough for it to see
    } catch (const zmq::error_t&) {                             // its connection has gone: seen by its monitor
      continue;
    }
    neighbour.progress_due = false;
    neighbour.told = count;
    ++neighbour.counts_unanswered;
  }
}

/// Between two calls: what would end the next one, passed on at once.
void TreeMesh::look_around() {
  if (abandoned_) return;
  try {
    receive_control();  // what belongs to the next call is kept
    read_monitors();
    check_neighbours();
  } catch (const RunError& error) {
    between_calls_ = error;
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
  call_ = next;
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
  if (interest.bulk_queue_full && bulk_lost_at_ && Clock::now() - *bulk_lost_at_ >= 2 * kGoodbyeGrace)
    throw RunError(worker(config_.identity.rank), fmt::format("the connection for gradients to worker {} broke", right()));
  poll_items_.clear();
  poll_items_.push_back({control_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_data) poll_items_.push_back({bulk_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_queue_full) poll_items_.push_back({bulk_out_.handle(), 0, ZMQ_POLLOUT, 0});
  for (const int rank : interest.full_control_queues) poll_items_.push_back({neighbour_of(rank)->control.handle(), 0, ZMQ_POLLOUT, 0});
  for (Neighbour& neighbour : neighbours_)
    if (!neighbour.lost_at) poll_items_.push_back({neighbour.monitor.handle(), 0, ZMQ_POLLIN, 0});
  if (!bulk_lost_at_) poll_items_.push_back({bulk_monitor_.handle(), 0, ZMQ_POLLIN, 0});
  send_progress();
  auto left = std::chrono::duration_cast<milliseconds>(deadline_ - Clock::now()) + milliseconds(1);
  left = left.count() > 0 ? std::min(left, kLongestWait) : milliseconds(20);
  const int count = zmq_poll(poll_items_.data(), static_cast<int>(poll_items_.size()), static_cast<long>(left.count()));
  if (count < 0 && zmq_errno() != EINTR) throw zmq::error_t();
  read_monitors();
}

void TreeMesh::finish_sends() {
  while (!lent_buffers_.wait_until_empty(Clock::now() + milliseconds(5))) {
    send_progress();
    while (auto frame = receive_control())
      throw RunError(worker(frame->from), fmt::format("calls {} where this worker still sends", name_of(frame->header.operation)));
    read_monitors();
    check_neighbours();
    check_deadline();
  }
}

void TreeMesh::abandon(const std::string& reason) {
  if (abandoned_) return;
  abandoned_ = reason.empty() ? "it was left" : reason;
  // After a call no payload is lent, but libzmq may still hold encrypted copies that it has not sent.
  if (reason.empty() && bulk_out_) bulk_out_.set(zmq::sockopt::linger, static_cast<int>(kFinalLinger.count()));
  send_goodbye(stopped_by_ ? *stopped_by_ : Stop{config_.identity.rank, reason.substr(0, kMaxReasonBytes)});
  close_all();
}

void TreeMesh::send_goodbye(const Stop& stop) {
  Goodbye goodbye;
  goodbye.reason = stop.reason;
  const std::string text = encode(goodbye);
  std::vector<Neighbour*> untold;
  for (Neighbour& neighbour : neighbours_) untold.push_back(&neighbour);
  FrameHeader header;
  header.operation = Operation::goodbye;
  header.run_key = run_key_;
  header.sequence = call_ + (is_open_ ? 1 : 0);
  header.step = static_cast<std::uint32_t>(stop.rank);
  header.length = header.total = text.size();
  const auto is_told = [&](Neighbour* neighbour) {
    if (!neighbour->control || neighbour->lost_at) return true;
    try {
      return send_message(neighbour->control, header, zmq::message_t(text));
    } catch (const zmq::error_t&) {  // it will see the connection close
      return true;
    }
  };
  // A full queue is one in the midst of a large call, and empties: who is not told would take this worker for the lost one.
  for (const auto deadline = Clock::now() + kGoodbyeGrace / 2;;) {
    std::erase_if(untold, is_told);
    if (untold.empty() || Clock::now() >= deadline) return;
    std::this_thread::sleep_for(milliseconds(5));
    read_monitors();
  }
}

void TreeMesh::close_all() {
  for (Neighbour& neighbour : neighbours_) {
    neighbour.control.close();
    neighbour.monitor.close();
  }
  bulk_out_.close();
  bulk_monitor_.close();
  bulk_in_.close();
  control_in_.close();
  gate_.reset();
  context_.close();  // waits until the I/O thread has dropped or sent everything: all lent payloads are back
}

}  // namespace earshot
