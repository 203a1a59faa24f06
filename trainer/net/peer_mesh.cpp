#include "trainer/net/peer_mesh.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <exception>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

// For a goodbye message to leave, or to arrive after its connection broke; on one host, where the others go on, the shorter one.
constexpr milliseconds kShutdownGrace{300}, kLocalGrace{40};
constexpr milliseconds kLongestWait{100}, kRegroupInterval{10};
constexpr milliseconds kBuffersBack{5000};          // for libzmq to drop what it had not sent, once the socket is closed
constexpr double kJoinPatience_s = 5;               // with a worker that was told that it may join
constexpr std::chrono::seconds kGuestPatience(10);  // of that worker: longer, so that it is the members who decide

std::string worker(int rank) { return fmt::format("worker {}", rank); }

}  // namespace

PeerMesh::PeerMesh(const RingConfig& config) : config_(config), exceptions_at_start_(std::uncaught_exceptions()) {
  validate(config_);
  grace_ = survives_loss() && !leaves_host(config_.rendezvous) ? kLocalGrace : kShutdownGrace;
  config_ = resolved(config_);
  security_ = LinkSecurity(config_);
  gate_ = security_.open_gate(context_);
  control_in_ = open_listener(context_, security_, kQueuedControl);
  bulk_in_ = open_listener(context_, security_, kQueuedMessages);
  const std::string control_endpoint = bind_listener(control_in_, config_, "control"),
                    bulk_endpoint = bind_listener(bulk_in_, config_, "bulk");
  const int world_size = config_.identity.world_size;
  peers_.resize(static_cast<std::size_t>(world_size));
  if (config_.incarnation != 0) {
    join(control_endpoint, bulk_endpoint);
    return;
  }
  table_ = meet(context_, config_, control_endpoint, bulk_endpoint, security_, survives_loss() ? &meeting_socket_ : nullptr);
  run_key_ = hash64(config_.run_id, table_.run_key);
  for (int rank = 0; rank < world_size; ++rank)
    if (rank != config_.identity.rank) connect(rank);
  views_.emplace(config_.identity.rank, View{0, world_size == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << world_size) - 1});
  set_members(views_->current().ranks());
  connect_bulk();
  open_meeting_point();
}

void PeerMesh::set_members(std::vector<int> ranks) {
  members_ = std::move(ranks);
  const auto own = std::ranges::find(members_, config_.identity.rank);
  identity_ = {static_cast<int>(own - members_.begin()), static_cast<int>(members_.size())};
  bulk_right_ = (identity_.rank + 1) % identity_.world_size;
  bulk_left_ = (identity_.rank + identity_.world_size - 1) % identity_.world_size;
}

void PeerMesh::link_bulk(int right, int left) {
  if (abandoned_) return;
  bulk_left_ = left;
  if (right == bulk_right_) return;
  bulk_right_ = right;
  bulk_out_.close();
  bulk_monitor_.close();
  connect_bulk();
}

PeerMesh::~PeerMesh() {
  try {
    if (abandoned_) return;
    if (std::uncaught_exceptions() > exceptions_at_start_)
      abandon("an error of its own");
    else
      abandon({});
  } catch (const std::exception& error) {
    spdlog::error("leaving the run: {}", error.what());
  }
}

void PeerMesh::connect(int rank) {
  Peer& peer = peers_[static_cast<std::size_t>(rank)];
  peer.control = open_dialer(context_, routing_id(), kShutdownGrace);
  security_.secure_dialer(peer.control, table_.public_keys[static_cast<std::size_t>(rank)]);
  const int interval_ms = static_cast<int>(config_.heartbeat.count());
  peer.control.set(zmq::sockopt::heartbeat_ivl, interval_ms);
  peer.control.set(zmq::sockopt::heartbeat_timeout, 4 * interval_ms);
  peer.monitor = monitor_of(context_, peer.control, fmt::format("inproc://peer-{}", ++num_monitors_));
  peer.control.connect(table_.control_endpoints[static_cast<std::size_t>(rank)]);
  peer.heard_at = Clock::now();
  peer.lost_at.reset();
  peer.finished_after.reset();
}

/// To the right neighbour, if there is one.  The routing id holds the epoch: the listener may still have the connection of the last view
/// under the other.
void PeerMesh::connect_bulk() {
  bulk_lost_at_.reset();
  if (right() == identity_.rank) return;
  const auto neighbour = static_cast<std::size_t>(members_[static_cast<std::size_t>(right())]);
  const std::uint32_t epoch = views_->current().epoch;
  // Its payloads are lent: they must come back when the caller leaves.
  bulk_out_ = open_dialer(context_, fmt::format("{}.{}", routing_id(), epoch), milliseconds(0));
  security_.secure_dialer(bulk_out_, table_.public_keys[neighbour]);
  bulk_monitor_ = monitor_of(context_, bulk_out_, fmt::format("inproc://bulk-{}-{}", epoch, neighbour));
  bulk_out_.connect(table_.bulk_endpoints[neighbour]);
}

std::string PeerMesh::routing_id() const { return routing_id_of(run_key_, config_.identity.rank, config_.incarnation); }

std::vector<int> PeerMesh::contacts() const {
  std::vector<int> ranks;
  for (int rank = 0; rank < config_.identity.world_size; ++rank)
    if (rank != config_.identity.rank && views_->knows(rank)) ranks.push_back(rank);
  return ranks;
}

void PeerMesh::begin(std::uint64_t sequence) {
  if (abandoned_) throw RunError("workers", fmt::format("the run was stopped before: {}", *abandoned_));
  sequence_ = sequence;
  call_began_ = Clock::now();
  deadline_ = call_began_ + config_.timeout;
}

bool PeerMesh::send_control(int peer, FrameHeader header, std::span<const std::byte> payload) {
  return send_to(members_[static_cast<std::size_t>(peer)], header, payload);
}

bool PeerMesh::send_to(int rank, FrameHeader header, std::span<const std::byte> payload) {
  header.run_key = run_key_;
  header.sequence = sequence_;
  header.epoch = views_->current().epoch;
  header.length = payload.size();
  return send_message(peers_[static_cast<std::size_t>(rank)].control, header, zmq::message_t(payload.data(), payload.size()));
}

bool PeerMesh::send_bulk(FrameHeader header, std::span<const std::byte> payload) {
  header.run_key = run_key_;
  header.sequence = sequence_;
  header.epoch = views_->current().epoch;
  header.length = payload.size();
  return send_message(bulk_out_, header, lent_message(payload, lent_buffers_));
}

std::optional<PeerMesh::Frame> PeerMesh::receive_from(zmq::socket_t& socket) {
  for (int unknown = 0; unknown < kUnknownAtOnce;) {
    std::optional<ReceivedMessage> message = receive_message(socket);
    if (!message) return std::nullopt;
    const PeerSender sender = sender_of(message->parts[0].to_string(), run_key_, config_.identity);
    if (sender.rank < 0) {
      if (++unknown_peers_ == 1) spdlog::warn("worker {} ignores messages of an unknown peer on its port", config_.identity.rank);
      ++unknown;
      continue;
    }
    if (!views_->knows(sender.rank) || peers_[static_cast<std::size_t>(sender.rank)].incarnation != sender.incarnation) {
      ++late_messages_;
      tell_left_out(sender);
      continue;
    }
    return frame_of(std::move(*message), sender.rank, run_key_);
  }
  return std::nullopt;  // a flood: first see whether the peers are alive
}

/// A worker that was left out has woken: it learns so over a connection of its own, at most once a second.
void PeerMesh::tell_left_out(PeerSender sender) {
  const auto now = Clock::now();
  Peer& peer = peers_[static_cast<std::size_t>(sender.rank)];
  if (now - peer.told_at < std::chrono::seconds(1)) return;
  peer.told_at = now;
  const bool former = sender.incarnation != peer.incarnation;
  const std::string endpoint = former ? peer.former_endpoint : table_.control_endpoints[static_cast<std::size_t>(sender.rank)];
  if (endpoint.empty()) return;  // of a start that this worker has never known
  zmq::socket_t notice = open_dialer(context_, routing_id(), kShutdownGrace);
  notice.set(zmq::sockopt::immediate, false);  // waits for the connection, as long as the socket lingers
  notice.set(zmq::sockopt::linger, 2000);
  security_.secure_dialer(notice, former ? peer.former_key : table_.public_keys[static_cast<std::size_t>(sender.rank)]);
  notice.connect(endpoint);
  ViewMessage message;
  message.epoch = views_->current().epoch;
  // Not the rank's of its next start.
  message.members = views_->current().members & ~(std::uint64_t{1} << sender.rank);
  const std::string text = encode(message);
  FrameHeader header;
  header.operation = Operation::view;
  header.run_key = run_key_;
  header.epoch = message.epoch;
  header.length = header.total = text.size();
  send_message(notice, header, zmq::message_t(text));
}

/// The frame with its sender's place.
std::optional<PeerMesh::Frame> PeerMesh::handed_out(Frame frame) const {
  frame.from = static_cast<int>(std::ranges::find(members_, frame.from) - members_.begin());
  return frame;
}

std::optional<PeerMesh::Frame> PeerMesh::receive_control() {
  const std::uint32_t epoch = views_->current().epoch;
  for (Peer& peer : peers_) {
    if (regrouping_ || peer.early.empty()) continue;
    if (peer.early.front().header.epoch != epoch || peer.early.front().header.sequence != sequence_) continue;
    Frame frame = std::move(peer.early.front());
    peer.early.pop_front();
    return handed_out(std::move(frame));
  }
  while (auto frame = receive_from(control_in_)) {
    Peer& peer = peers_[static_cast<std::size_t>(frame->from)];
    peer.heard_at = Clock::now();
    const FrameHeader& header = frame->header;
    if (header.operation == Operation::goodbye) {
      take_goodbye(*frame);
    } else if (header.operation == Operation::view) {
      take_view(*frame);
    } else if (header.operation == Operation::progress) {
      take_progress(*frame);
    } else if (header.epoch > epoch || (header.epoch == epoch && header.sequence == sequence_ + 1)) {
      peer.early.push_back(std::move(*frame));
    } else if (header.epoch < epoch || regrouping_) {
      ++late_messages_;
    } else if (header.sequence == sequence_) {
      return handed_out(std::move(*frame));
    } else {  // every call needs something from every worker, so no worker can be two calls ahead, or behind
      throw RunError(worker(frame->from), fmt::format("is at collective call {} where this worker is at {}", header.sequence, sequence_));
    }
  }
  return std::nullopt;
}

std::optional<PeerMesh::Frame> PeerMesh::receive_bulk() {
  const std::uint32_t epoch = views_->current().epoch;
  std::optional<Frame> frame;
  if (!early_bulk_.empty() && early_bulk_.front().header.epoch == epoch) {
    frame = std::move(early_bulk_.front());
    early_bulk_.pop_front();
  } else {
    frame = receive_from(bulk_in_);
    while (frame && frame->header.epoch < epoch) {
      ++late_messages_;
      frame = receive_from(bulk_in_);
    }
    if (frame && frame->header.epoch > epoch) {
      early_bulk_.push_back(std::move(*frame));
      return std::nullopt;
    }
  }
  if (!frame) return frame;
  if (frame->from != members_[static_cast<std::size_t>(left())] || frame->header.sequence != sequence_)
    throw RunError(worker(frame->from), fmt::format("sends part of collective call {} where call {} of worker {} is due",
                                                    frame->header.sequence, sequence_, members_[static_cast<std::size_t>(left())]));
  return handed_out(std::move(*frame));
}

void PeerMesh::take_goodbye(const Frame& frame) {
  Goodbye goodbye;
  try {
    goodbye = decode<Goodbye>(frame.payload.to_string_view());
  } catch (const WireError& error) {
    throw RunError(worker(frame.from), fmt::format("breaks the protocol: {}", error.what()));
  }
  // Of one that is being left out: it has stopped no more than itself.
  if (!goodbye.reason.empty() && (!regrouping_ || views_->proposal().has(frame.from)))
    throw RunError(worker(frame.from), fmt::format("stopped the run: {}", goodbye.reason));
  peers_[static_cast<std::size_t>(frame.from)].finished_after = frame.header.sequence;
}

void PeerMesh::take_view(const Frame& frame) {
  try {
    if (!survives_loss()) throw WireError("a view, where a lost worker is the end (do all have the same network.on_loss?)");
    const auto message = decode<ViewMessage>(frame.payload.to_string_view());
    const View view{message.epoch, message.members};
    // A worker that joins may have proposed before this one knew of it; and one that proposes now hears so again.
    if (is_guest_ && regrouping_) peers_[static_cast<std::size_t>(frame.from)].proposal_due = true;
    const auto effect = views_->receive(frame.from, view);
    if (effect == ViewAgreement::Effect::excluded) {
      left_out_ = true;
      if (is_guest_) throw LeftOut(worker(config_.identity.rank), "was not let in, as another change of membership came first");
      throw LeftOut(worker(config_.identity.rank),
                    fmt::format("was left out of the run after a pause: worker {} go on without it; what it did since is void, nothing is "
                                "to be resumed",
                                fmt::join(view.ranks(), ", ")));
    }
  } catch (const WireError& error) {
    throw RunError(worker(frame.from), fmt::format("breaks the protocol: {}", error.what()));
  }
  if (views_->is_open() && !regrouping_ && !peeking_) throw Disruption{};
}

void PeerMesh::take_progress(const Frame& frame) {
  if (frame.header.phase == 0) deadline_ = Clock::now() + config_.timeout;
}

void PeerMesh::read_monitors() {
  const auto now = Clock::now();
  for (Peer& peer : peers_)
    if (peer.monitor && has_ended(peer.monitor) && !peer.lost_at) peer.lost_at = now;
  if (bulk_monitor_ && has_ended(bulk_monitor_) && !bulk_lost_at_) bulk_lost_at_ = now;
}

/// A lost peer is the end of the run, or of this view.
void PeerMesh::lose(int rank, const std::string& what) {
  if (!survives_loss()) throw RunError(worker(rank), what);
  spdlog::warn("worker {}: {}", rank, what);
  views_->leave_out(rank);
}

void PeerMesh::check_peers(const std::vector<int>& awaited) {
  const auto now = Clock::now();
  const milliseconds patience(static_cast<std::int64_t>(1000 * config_.network.progress_timeout_s));
  for (const int rank : members_) {
    const Peer& peer = peers_[static_cast<std::size_t>(rank)];
    if (peer.finished_after) {
      // It has done its part of this call or it never will; what it did send may still be on its way.
      if (*peer.finished_after < sequence_)
        throw RunError(worker(rank),
                       fmt::format("has left the run after {} collective calls, this worker makes another", *peer.finished_after));
    } else if (peer.lost_at && now - *peer.lost_at >= grace_) {
      lose(rank, fmt::format("has gone in collective call {}: it was killed, crashed, or hangs", sequence_));
    }
  }
  for (const int place : awaited) {
    const int rank = members_[static_cast<std::size_t>(place)];
    const auto silent = now - std::max(peer_at(place).heard_at, call_began_);
    if (rank != config_.identity.rank && silent >= patience)
      lose(rank,
           fmt::format("has made no progress for {} ms, in or before collective call {}: it hangs in a loop", patience.count(), sequence_));
  }
  if (identity_.world_size > 1 && bulk_in_use_ && bulk_lost_at_ && now - *bulk_lost_at_ >= 2 * grace_) {
    const Peer& neighbour = peer_at(right());
    if (!neighbour.finished_after && !neighbour.lost_at) {
      const std::string what = fmt::format("the connection for gradients to worker {} broke", members_[static_cast<std::size_t>(right())]);
      if (!survives_loss()) throw RunError(worker(config_.identity.rank), what);
      spdlog::warn("worker {}: {}, and is opened anew", config_.identity.rank, what);
      views_->renew();
    }
  }
  if (views_->is_open()) throw Disruption{};
  if (now < deadline_) return;
  std::vector<int> ranks;
  for (const int place : awaited) ranks.push_back(members_[static_cast<std::size_t>(place)]);
  throw RunError(fmt::format("worker {}", fmt::join(ranks, ", ")),
                 fmt::format("did not take part in collective call {} within {} ms", sequence_, config_.timeout.count()));
}

void PeerMesh::send_progress(bool waiting) {
  const auto now = Clock::now();
  if (std::chrono::duration<double>(now - progress_sent_at_).count() < std::min(5.0, config_.network.progress_timeout_s / 8)) return;
  progress_sent_at_ = now;
  FrameHeader header;
  header.operation = Operation::progress;
  header.phase = waiting ? 1 : 0;
  header.total = progress_;
  for (const int rank : contacts()) {
    if (peers_[static_cast<std::size_t>(rank)].lost_at) continue;
    try {
      send_to(rank, header, {});     // a full queue has messages enough for it to see
    } catch (const zmq::error_t&) {  // its connection has gone: seen in the next call
    }
  }
}

void PeerMesh::note_progress() {
  ++progress_;
  if (abandoned_) return;
  send_progress(false);
  look_at_meeting_point();
}

int PeerMesh::num_waiting(std::uint64_t next) {
  if (abandoned_) return 0;
  sequence_ = next - 1;  // of call 0, too: the call after this one is `next`, whose messages are kept
  peeking_ = true;       // a change of membership is the next call's business
  while (receive_control()) {
  }
  peeking_ = false;
  int count = 0;
  for (const Peer& peer : peers_)
    count +=
        !peer.early.empty() && peer.early.front().header.epoch == views_->current().epoch && peer.early.front().header.sequence == next;
  return count;
}

/// The proposal to all that have not had it; to those that it leaves out once, so that they know when they wake.
void PeerMesh::send_proposals() {
  ViewMessage message;
  message.epoch = views_->proposal().epoch;
  message.members = views_->proposal().members;
  const std::string text = encode(message);
  FrameHeader header;
  header.operation = Operation::view;
  header.total = text.size();
  for (const int rank : contacts()) {
    Peer& peer = peers_[static_cast<std::size_t>(rank)];
    if (!peer.proposal_due) continue;
    const bool sent = peer.control && send_to(rank, header, std::as_bytes(std::span(text)));
    if (sent || !views_->proposal().has(rank)) peer.proposal_due = false;
  }
}

void PeerMesh::drop_lost_peers(Clock::time_point since) {
  const auto now = Clock::now();
  for (const int rank : views_->proposal().ranks()) {
    const Peer& peer = peers_[static_cast<std::size_t>(rank)];
    // A worker that joins cannot cost a member its place: who does not reach all others gives up.
    if (rank == config_.identity.rank || (is_guest_ && !peer.joins)) continue;
    const double patience_s =
        peer.joins ? std::min(kJoinPatience_s, config_.network.progress_timeout_s) : config_.network.progress_timeout_s;
    const bool silent = std::chrono::duration<double>(now - std::max(peer.heard_at, since)).count() >= patience_s;
    if (peer.finished_after || silent || (peer.lost_at && now - *peer.lost_at >= grace_)) {
      spdlog::warn("worker {}: {}", rank, peer.joins ? "did not come in time, or went again: it has not joined" : "has gone as well");
      views_->leave_out(rank);
    }
  }
}

LeftOut PeerMesh::too_few() const {
  return {
      worker(config_.identity.rank),
      fmt::format("reaches only worker {} of {}: others may go on without them, so that it ends here; if they did not, go on with --resume",
                  fmt::join(views_->proposal().ranks(), ", "), fmt::join(members_, ", "))};
}

PeerMesh::Change PeerMesh::regroup() {
  regrouping_ = true;
  bulk_out_.close();
  bulk_monitor_.close();
  if (!lent_buffers_.wait_until_empty(Clock::now() + kBuffersBack)) throw RunError("ZeroMQ", "does not give lent buffers back");

  const auto began = Clock::now();
  View sent;
  while (true) {
    while (receive_control()) {
    }
    read_monitors();
    drop_lost_peers(began);
    if (!views_->has_quorum()) {
      left_out_ = true;
      throw too_few();
    }
    if (sent != views_->proposal())
      for (Peer& peer : peers_) peer.proposal_due = true;
    sent = views_->proposal();
    send_proposals();
    send_progress(true);
    look_at_meeting_point();
    if (is_guest_ && Clock::now() - began >= kGuestPatience) {
      left_out_ = true;
      throw LeftOut(worker(config_.identity.rank), fmt::format("was not let in by worker {}", fmt::join(views_->current().ranks(), ", ")));
    }
    const auto ranks = sent.ranks();
    const bool all_know = std::ranges::none_of(
        ranks, [&](int rank) { return rank != config_.identity.rank && peers_[static_cast<std::size_t>(rank)].proposal_due; });
    if (all_know && views_->is_decided()) break;
    zmq_pollitem_t item{control_in_.handle(), 0, ZMQ_POLLIN, 0};
    if (zmq_poll(&item, 1, static_cast<long>(kRegroupInterval.count())) < 0 && zmq_errno() != EINTR) throw zmq::error_t();
  }
  return adopt();
}

void PeerMesh::wait(const Interest& interest) {
  look_at_meeting_point();
  check_peers(interest.awaited);
  poll_items_.clear();
  poll_items_.push_back({control_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_data) poll_items_.push_back({bulk_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_queue_full) poll_items_.push_back({bulk_out_.handle(), 0, ZMQ_POLLOUT, 0});
  for (const int peer : interest.full_control_queues) poll_items_.push_back({peer_at(peer).control.handle(), 0, ZMQ_POLLOUT, 0});
  bool grace = bulk_in_use_ && bulk_lost_at_.has_value();
  for (Peer& peer : peers_) {
    if (peer.monitor && !peer.lost_at) poll_items_.push_back({peer.monitor.handle(), 0, ZMQ_POLLIN, 0});
    grace = grace || (peer.monitor && peer.lost_at && !peer.finished_after);
  }
  if (bulk_monitor_ && !bulk_lost_at_) poll_items_.push_back({bulk_monitor_.handle(), 0, ZMQ_POLLIN, 0});
  send_progress(true);
  auto left = std::chrono::duration_cast<milliseconds>(deadline_ - Clock::now()) + milliseconds(1);
  left = std::min(left, kLongestWait);
  if (grace) left = std::min(left, milliseconds(20));  // for its goodbye message; then it counts as dead
  const int count = zmq_poll(poll_items_.data(), static_cast<int>(poll_items_.size()), std::max<long>(0, static_cast<long>(left.count())));
  if (count < 0 && zmq_errno() != EINTR) throw zmq::error_t();
  read_monitors();
}

void PeerMesh::check(int awaited) {
  look_at_meeting_point();
  send_progress(true);
  read_monitors();
  check_peers({awaited});
}

void PeerMesh::finish_sends() {
  while (!lent_buffers_.wait_until_empty(Clock::now() + milliseconds(5))) {
    send_progress(true);
    while (auto frame = receive_control())
      throw RunError(worker(members_[static_cast<std::size_t>(frame->from)]),
                     fmt::format("calls {} where this worker still sends", name_of(frame->header.operation)));
    read_monitors();
    check_peers({right()});
  }
}

void PeerMesh::abandon(const std::string& reason) {
  if (abandoned_) return;
  abandoned_ = reason.empty() ? "it was left" : reason;
  if (reason.empty()) let_messages_leave();
  if (!left_out_ && !is_guest_) send_goodbye(reason.substr(0, kMaxReasonBytes));  // whoever is not in has no say in the run of the others
  close_all();
}

/// After a call no payload is lent, but libzmq may still hold encrypted copies that it has not sent.
void PeerMesh::let_messages_leave() {
  const int linger_ms = static_cast<int>(kFinalLinger.count());
  if (bulk_out_) bulk_out_.set(zmq::sockopt::linger, linger_ms);
  for (Peer& peer : peers_)
    if (peer.control) peer.control.set(zmq::sockopt::linger, linger_ms);
}

void PeerMesh::send_goodbye(const std::string& reason) {
  Goodbye goodbye;
  goodbye.reason = reason;
  const std::string text = encode(goodbye);
  for (Peer& peer : peers_) {
    if (!peer.control || peer.lost_at) continue;
    FrameHeader header;
    header.operation = Operation::goodbye;
    header.run_key = run_key_;
    header.sequence = sequence_;
    header.epoch = views_->current().epoch;
    header.length = header.total = text.size();
    try {
      send_message(peer.control, header, zmq::message_t(text));
    } catch (const zmq::error_t&) {  // it will see the connection close
    }
  }
}

void PeerMesh::close_all() {
  meeting_point_.reset();
  for (Peer& peer : peers_) {
    peer.control.close();
    peer.monitor.close();
  }
  bulk_out_.close();
  bulk_monitor_.close();
  bulk_in_.close();
  control_in_.close();
  gate_.reset();
  remove_listening_files();
  context_.close();  // waits until the I/O thread has dropped or sent everything: all lent payloads are back
}

}  // namespace earshot
