#include "trainer/peer_mesh.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstring>
#include <exception>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/rendezvous.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

constexpr int kQueuedMessages = 4;                // per peer and direction: at most 4 MiB wait
constexpr std::int64_t kCurveOverheadBytes = 64;  // libzmq compares the size of the sealed frame, 33 bytes more than its content
constexpr std::int64_t kMaxFrameBytes = static_cast<std::int64_t>(kChunkBytes) + kCurveOverheadBytes;
constexpr milliseconds kShutdownGrace{300};  // for a goodbye message to leave, or to arrive after its connection broke
constexpr std::size_t kMaxReasonBytes = 600;
constexpr int kUnknownAtOnce = 1000;  // messages of unknown peers that are dropped before anything else is looked at again

std::string worker(int rank) { return fmt::format("worker {}", rank); }

zmq::socket_t listener(zmq::context_t& context, const LinkSecurity& security) {
  zmq::socket_t socket(context, zmq::socket_type::router);
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::maxmsgsize, kMaxFrameBytes);
  socket.set(zmq::sockopt::rcvhwm, kQueuedMessages);
  security.secure_listener(socket);
  return socket;
}

zmq::socket_t dial(zmq::context_t& context, const std::string& routing_id) {
  zmq::socket_t socket(context, zmq::socket_type::dealer);
  socket.set(zmq::sockopt::routing_id, routing_id);
  socket.set(zmq::sockopt::linger, static_cast<int>(kShutdownGrace.count()));
  socket.set(zmq::sockopt::maxmsgsize, kMaxFrameBytes);
  socket.set(zmq::sockopt::sndhwm, kQueuedMessages);
  socket.set(zmq::sockopt::immediate, true);    // nothing is queued for a connection that is not up
  socket.set(zmq::sockopt::reconnect_ivl, -1);  // a broken connection has lost messages: it is the end, not a pause
  socket.set(zmq::sockopt::ipv6, true);         // IPv4 as well
  return socket;
}

void give_back_buffer(void*, void* lent_buffers) { static_cast<BuffersInFlight*>(lent_buffers)->give_back(); }

/// Header and payload as one message of two parts; false if the queue is full.
bool send_message(zmq::socket_t& socket, const FrameHeader& header, zmq::message_t payload) {
  const auto head = encode_header(header);
  try {
    if (!socket.send(zmq::buffer(head), zmq::send_flags::sndmore | zmq::send_flags::dontwait)) return false;
  } catch (const zmq::error_t& error) {
    if (error.num() == EINTR) return false;
    throw;
  }
  // The parts of one message enter the queue together: the second cannot find it full.
  return socket.send(std::move(payload), zmq::send_flags::dontwait).has_value();
}

}  // namespace

void BuffersInFlight::lend() {
  const std::lock_guard lock(mutex_);
  ++count_;
}

void BuffersInFlight::give_back() {
  const std::lock_guard lock(mutex_);
  if (--count_ == 0) empty_.notify_one();
}

bool BuffersInFlight::wait_until_empty(std::chrono::steady_clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  return empty_.wait_until(lock, deadline, [this] { return count_ == 0; });
}

PeerMesh::PeerMesh(const RingConfig& config) : config_(config), exceptions_at_start_(std::uncaught_exceptions()) {
  validate(config_);
  config_ = resolved(config_);
  security_ = LinkSecurity(config_);
  gate_ = security_.open_gate(context_);
  control_in_ = listener(context_, security_);
  bulk_in_ = listener(context_, security_);
  const std::string control_endpoint = bind_listener(control_in_, config_, "control"),
                    bulk_endpoint = bind_listener(bulk_in_, config_, "bulk");
  const PeerTable table = meet(context_, config_, control_endpoint, bulk_endpoint, security_);
  run_key_ = hash64(config_.run_id, table.run_key);

  peers_.resize(static_cast<std::size_t>(config_.identity.world_size));
  for (int rank = 0; rank < config_.identity.world_size; ++rank) {
    if (rank == config_.identity.rank) continue;
    const auto place = static_cast<std::size_t>(rank);
    rank_of_routing_id_[fmt::format("E{:016x}.{}", run_key_, rank)] = rank;
    connect(rank, table.control_endpoints[place], table.public_keys[place]);
  }
  bulk_out_ = dial(context_, fmt::format("E{:016x}.{}", run_key_, config_.identity.rank));
  bulk_out_.set(zmq::sockopt::linger, 0);  // its payloads are lent: they must come back when the caller leaves
  const auto neighbour = static_cast<std::size_t>(right());
  security_.secure_dialer(bulk_out_, table.public_keys[neighbour]);
  bulk_out_.connect(table.bulk_endpoints[neighbour]);
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

void PeerMesh::connect(int rank, const std::string& control_endpoint, const std::string& public_key) {
  Peer& peer = peers_[static_cast<std::size_t>(rank)];
  peer.control = dial(context_, fmt::format("E{:016x}.{}", run_key_, config_.identity.rank));
  security_.secure_dialer(peer.control, public_key);
  const int interval_ms = static_cast<int>(config_.heartbeat.count());
  peer.control.set(zmq::sockopt::heartbeat_ivl, interval_ms);
  peer.control.set(zmq::sockopt::heartbeat_timeout, 4 * interval_ms);
  const std::string events = fmt::format("inproc://peer-{}", rank);
  if (zmq_socket_monitor(peer.control.handle(), events.c_str(), ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_CLOSED) != 0) throw zmq::error_t();
  peer.monitor = zmq::socket_t(context_, zmq::socket_type::pair);
  peer.monitor.set(zmq::sockopt::linger, 0);
  peer.monitor.connect(events);
  peer.control.connect(control_endpoint);
}

void PeerMesh::begin(std::uint64_t sequence) {
  if (abandoned_) throw RunError("workers", fmt::format("the run was stopped before: {}", *abandoned_));
  sequence_ = sequence;
  deadline_ = Clock::now() + config_.timeout;
}

bool PeerMesh::send_control(int peer, FrameHeader header, std::span<const std::byte> payload) {
  header.run_key = run_key_;
  header.sequence = sequence_;
  header.length = payload.size();
  return send_message(peers_[static_cast<std::size_t>(peer)].control, header, zmq::message_t(payload.data(), payload.size()));
}

bool PeerMesh::send_bulk(FrameHeader header, std::span<const std::byte> payload) {
  header.run_key = run_key_;
  header.sequence = sequence_;
  header.length = payload.size();
  lent_buffers_.lend();
  // libzmq never writes to the payload; its interface only lacks the const.  A message that is not sent gives the buffer back in its
  // destructor.
  return send_message(bulk_out_, header,
                      zmq::message_t(const_cast<std::byte*>(payload.data()), payload.size(), give_back_buffer, &lent_buffers_));
}

std::optional<PeerMesh::Frame> PeerMesh::receive_from(zmq::socket_t& socket) {
  for (int unknown = 0; unknown < kUnknownAtOnce;) {
    std::array<zmq::message_t, 3> parts;
    std::size_t count = 0;
    bool more = true;
    while (more) {
      zmq::message_t surplus;
      zmq::message_t& part = count < parts.size() ? parts[count] : surplus;
      try {
        if (!socket.recv(part, zmq::recv_flags::dontwait)) return std::nullopt;
      } catch (const zmq::error_t& error) {
        if (error.num() == EINTR) continue;
        throw;
      }
      ++count;
      more = part.more();
    }
    const auto sender = rank_of_routing_id_.find(parts[0].to_string());
    if (sender == rank_of_routing_id_.end()) {
      if (++unknown_peers_ == 1) spdlog::warn("worker {} ignores messages of an unknown peer on its port", config_.identity.rank);
      ++unknown;
      continue;
    }
    Frame frame;
    frame.from = sender->second;
    try {
      if (count != parts.size()) throw WireError(fmt::format("message of {} parts", count));
      frame.header = decode_header({parts[1].data<const std::byte>(), parts[1].size()});
      if (frame.header.run_key != run_key_) throw WireError("frame of another run");
      if (frame.header.length != parts[2].size())
        throw WireError(fmt::format("{} bytes announced, {} sent", frame.header.length, parts[2].size()));
    } catch (const WireError& error) {
      throw RunError(worker(frame.from), fmt::format("breaks the protocol: {}", error.what()));
    }
    frame.payload = std::move(parts[2]);
    return frame;
  }
  return std::nullopt;  // a flood: first see whether the peers are alive
}

std::optional<PeerMesh::Frame> PeerMesh::receive_control() {
  for (Peer& peer : peers_) {
    if (peer.early.empty() || peer.early.front().header.sequence != sequence_) continue;
    Frame frame = std::move(peer.early.front());
    peer.early.pop_front();
    return frame;
  }
  while (auto frame = receive_from(control_in_)) {
    if (frame->header.operation == Operation::goodbye) {
      take_goodbye(*frame);
      continue;
    }
    if (frame->header.sequence == sequence_) return frame;
    // Every call needs something from every worker, so no worker can be two calls ahead, or behind.
    if (frame->header.sequence != sequence_ + 1)
      throw RunError(worker(frame->from),
                     fmt::format("is at collective call {} where this worker is at {}", frame->header.sequence, sequence_));
    peers_[static_cast<std::size_t>(frame->from)].early.push_back(std::move(*frame));
  }
  return std::nullopt;
}

std::optional<PeerMesh::Frame> PeerMesh::receive_bulk() {
  auto frame = receive_from(bulk_in_);
  if (frame && (frame->from != left() || frame->header.sequence != sequence_))
    throw RunError(worker(frame->from), fmt::format("sends part of collective call {} where call {} of worker {} is due",
                                                    frame->header.sequence, sequence_, left()));
  return frame;
}

void PeerMesh::take_goodbye(const Frame& frame) {
  Goodbye goodbye;
  try {
    goodbye = decode<Goodbye>(frame.payload.to_string_view());
  } catch (const WireError& error) {
    throw RunError(worker(frame.from), fmt::format("breaks the protocol: {}", error.what()));
  }
  if (!goodbye.reason.empty()) throw RunError(worker(frame.from), fmt::format("stopped the run: {}", goodbye.reason));
  peers_[static_cast<std::size_t>(frame.from)].finished_after = frame.header.sequence;
}

void PeerMesh::read_monitors() {
  for (Peer& peer : peers_) {
    if (!peer.monitor) continue;
    zmq::message_t event;
    while (peer.monitor.recv(event, zmq::recv_flags::dontwait)) {
      std::uint16_t number = 0;
      if (event.size() >= sizeof(number)) std::memcpy(&number, event.data(), sizeof(number));
      zmq::message_t address;
      if (event.more() && !peer.monitor.recv(address, zmq::recv_flags::dontwait)) break;
      if ((number == ZMQ_EVENT_DISCONNECTED || number == ZMQ_EVENT_CLOSED) && !peer.lost_at) peer.lost_at = Clock::now();
    }
  }
}

void PeerMesh::check_peers(const std::vector<int>& awaited) const {
  const auto now = Clock::now();
  for (int rank = 0; rank < config_.identity.world_size; ++rank) {
    const Peer& peer = peers_[static_cast<std::size_t>(rank)];
    if (peer.finished_after) {
      // It has done its part of this call or it never will; what it did send may still be on its way.
      if (*peer.finished_after < sequence_)
        throw RunError(worker(rank),
                       fmt::format("has left the run after {} collective calls, this worker makes another", *peer.finished_after));
    } else if (peer.lost_at && now - *peer.lost_at >= kShutdownGrace) {
      throw RunError(worker(rank), fmt::format("has gone in collective call {}: it was killed, crashed, or hangs", sequence_));
    }
  }
  if (now >= deadline_)
    throw RunError(fmt::format("worker {}", fmt::join(awaited, ", ")),
                   fmt::format("did not take part in collective call {} within {} ms", sequence_, config_.timeout.count()));
}

void PeerMesh::wait(const Interest& interest) {
  check_peers(interest.awaited);
  poll_items_.clear();
  poll_items_.push_back({control_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_data) poll_items_.push_back({bulk_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_queue_full) poll_items_.push_back({bulk_out_.handle(), 0, ZMQ_POLLOUT, 0});
  for (const int peer : interest.full_control_queues)
    poll_items_.push_back({peers_[static_cast<std::size_t>(peer)].control.handle(), 0, ZMQ_POLLOUT, 0});
  bool grace = false;
  for (Peer& peer : peers_) {
    if (peer.monitor && !peer.lost_at) poll_items_.push_back({peer.monitor.handle(), 0, ZMQ_POLLIN, 0});
    grace = grace || (peer.lost_at && !peer.finished_after);
  }
  auto left = std::chrono::duration_cast<milliseconds>(deadline_ - Clock::now()) + milliseconds(1);
  if (grace) left = std::min(left, milliseconds(20));  // for its goodbye message; then it counts as dead
  const int count = zmq_poll(poll_items_.data(), static_cast<int>(poll_items_.size()), std::max<long>(0, static_cast<long>(left.count())));
  if (count < 0 && zmq_errno() != EINTR) throw zmq::error_t();
  read_monitors();
}

void PeerMesh::check(int awaited) {
  read_monitors();
  check_peers({awaited});
}

void PeerMesh::finish_sends() {
  while (!lent_buffers_.wait_until_empty(Clock::now() + milliseconds(5))) {
    while (auto frame = receive_control())
      throw RunError(worker(frame->from), fmt::format("calls {} where this worker still sends", name_of(frame->header.operation)));
    read_monitors();
    check_peers({right()});
  }
}

void PeerMesh::abandon(const std::string& reason) {
  if (abandoned_) return;
  abandoned_ = reason.empty() ? "it was left" : reason;
  send_goodbye(reason.substr(0, kMaxReasonBytes));
  close_all();
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
    header.length = header.total = text.size();
    try {
      send_message(peer.control, header, zmq::message_t(text));
    } catch (const zmq::error_t&) {  // it will see the connection close
    }
  }
}

void PeerMesh::close_all() {
  for (Peer& peer : peers_) {
    peer.control.close();
    peer.monitor.close();
  }
  bulk_out_.close();
  bulk_in_.close();
  control_in_.close();
  gate_.reset();
  context_.close();  // waits until the I/O thread has dropped or sent everything: all lent payloads are back
}

}  // namespace earshot
