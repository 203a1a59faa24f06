// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/peer_links.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <string_view>
#include <utility>

#include "sim/base/text/log.h"
#include "trainer/net/rendezvous.h"

namespace earshot {
namespace {

using std::chrono::milliseconds;

constexpr int kQueuedMessages = 4;    // per peer and direction: at most 4 MiB wait
constexpr int kUnknownAtOnce = 1000;  // messages of unknown peers that are dropped before anything else is looked at again
constexpr int kNoticeLinger_ms = 2000;
constexpr milliseconds kFinalLinger{5000};
constexpr std::int64_t kCurveOverheadBytes = 64;  // libzmq compares the size of the sealed frame, 33 bytes more than its content
constexpr std::int64_t kMaxFrameBytes = static_cast<std::int64_t>(kChunkBytes) + kCurveOverheadBytes;

void give_back_buffer(void*, void* lent_buffers) { static_cast<BuffersInFlight*>(lent_buffers)->give_back(); }

/// queued: messages that it takes in ahead of its reader, per peer.
zmq::socket_t open_listener(zmq::context_t& context, const LinkSecurity& security, int queued) {
  zmq::socket_t socket(context, zmq::socket_type::router);
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::maxmsgsize, kMaxFrameBytes);
  socket.set(zmq::sockopt::rcvhwm, queued);
  security.secure_listener(socket);
  return socket;
}

/// linger: longest time that unsent messages delay the end.
zmq::socket_t open_dialer(zmq::context_t& context, const std::string& routing_id, milliseconds linger) {
  zmq::socket_t socket(context, zmq::socket_type::dealer);
  socket.set(zmq::sockopt::routing_id, routing_id);
  socket.set(zmq::sockopt::linger, static_cast<int>(linger.count()));
  socket.set(zmq::sockopt::maxmsgsize, kMaxFrameBytes);
  socket.set(zmq::sockopt::sndhwm, kQueuedMessages);
  socket.set(zmq::sockopt::immediate, true);    // nothing is queued for a connection that is not up
  socket.set(zmq::sockopt::reconnect_ivl, -1);  // a broken connection has lost messages: it is the end, not a pause
  socket.set(zmq::sockopt::ipv6, true);         // IPv4 as well
  return socket;
}

/// Whether a monitor tells of an end.  Reads all that there is.
bool has_ended(SocketMonitor& monitor) {
  bool ended = false;
  while (const auto event = monitor.next()) ended = ended || *event == ZMQ_EVENT_DISCONNECTED || *event == ZMQ_EVENT_CLOSED;
  return ended;
}

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

/// A payload that is read from the caller's memory until it is given back.  A message that is not sent gives it back at once.
zmq::message_t lent_message(std::span<const std::byte> payload, BuffersInFlight& buffers) {
  buffers.lend();
  // libzmq never writes to the payload; its interface only lacks the const.
  return {const_cast<std::byte*>(payload.data()), payload.size(), give_back_buffer, &buffers};
}

/// A worker names itself to listeners.  Another id for each start of a rank: a listener may still have the connections of the start before.
std::string routing_id_of(std::uint64_t run_key, int rank, std::uint32_t incarnation) {
  return fmt::format("E{:016x}.{}.{:08x}", run_key, rank, incarnation);
}

/// Whose routing id this is; one may end with "." and a number.
PeerSender sender_of(const std::string& routing_id, std::uint64_t run_key, WorkerIdentity identity) {
  const std::string prefix = fmt::format("E{:016x}.", run_key);
  if (!routing_id.starts_with(prefix)) return {};
  const char* const end = routing_id.data() + routing_id.size();
  PeerSender sender;
  const auto [dot, error] = std::from_chars(routing_id.data() + prefix.size(), end, sender.rank);
  if (error != std::errc() || dot == end || *dot != '.') return {};
  if (sender.rank < 0 || sender.rank >= identity.world_size || sender.rank == identity.rank) return {};
  const auto [rest, no_incarnation] = std::from_chars(dot + 1, end, sender.incarnation, 16);
  if (no_incarnation != std::errc()) return {};
  if (rest == end) return sender;
  std::uint32_t epoch = 0;
  const auto [last, no_epoch] = std::from_chars(rest + 1, end, epoch);
  return *rest == '.' && no_epoch == std::errc() && last == end ? sender : PeerSender{};
}

/// Routing id, header, payload, where it is a message of ours.
struct ReceivedMessage {
  std::array<zmq::message_t, 3> parts;
  std::size_t count = 0;  ///< may be more: those are dropped
};

/// The next message of a listener, if one has come.
std::optional<ReceivedMessage> receive_message(zmq::socket_t& socket) {
  ReceivedMessage message;
  bool has_more = true;
  while (has_more) {
    zmq::message_t surplus;
    zmq::message_t& part = message.count < message.parts.size() ? message.parts[message.count] : surplus;
    try {
      if (!socket.recv(part, zmq::recv_flags::dontwait)) return std::nullopt;
    } catch (const zmq::error_t& error) {
      if (error.num() == EINTR) continue;
      throw;
    }
    ++message.count;
    has_more = part.more();
  }
  return message;
}

/// Throws RunError where it breaks the protocol.
PeerFrame frame_of(ReceivedMessage message, int from, std::uint64_t run_key) {
  PeerFrame frame;
  frame.from = from;
  auto& parts = message.parts;
  try {
    if (message.count != parts.size()) throw WireError(fmt::format("message with {} parts", message.count));
    frame.header = decode_header({parts[1].data<const std::byte>(), parts[1].size()});
    if (frame.header.run_key != run_key) throw WireError("frame from another run");
    if (frame.header.length != parts[2].size())
      throw WireError(fmt::format("{} bytes announced, {} sent", frame.header.length, parts[2].size()));
  } catch (const WireError& error) {
    throw protocol_breach(from, error);
  }
  frame.payload = std::move(parts[2]);
  return frame;
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

void KeptFrames::put(PeerFrame frame) { frames_[frame.from].push_back(std::move(frame)); }

std::optional<PeerFrame> KeptFrames::take(std::uint32_t epoch, std::uint64_t sequence) {
  for (auto& [rank, frames] : frames_) {
    if (frames.empty() || frames.front().header.epoch != epoch || frames.front().header.sequence != sequence) continue;
    PeerFrame frame = std::move(frames.front());
    frames.pop_front();
    return frame;
  }
  return std::nullopt;
}

int KeptFrames::num_peers(std::uint32_t epoch, std::uint64_t sequence) const {
  return static_cast<int>(std::ranges::count_if(frames_, [&](const auto& of_peer) {
    const auto& frames = of_peer.second;
    return !frames.empty() && frames.front().header.epoch == epoch && frames.front().header.sequence == sequence;
  }));
}

void KeptFrames::drop_before(std::uint32_t epoch) {
  for (auto& [rank, frames] : frames_)
    while (!frames.empty() && frames.front().header.epoch < epoch) frames.pop_front();
}

PeerLinks::PeerLinks(const RingConfig& config, milliseconds linger)
    : config_(config),
      linger_(linger),
      security_(config),
      gate_(security_.open_gate(context_)),
      control_in_(open_listener(context_, security_, kQueuedControl)),
      bulk_in_(open_listener(context_, security_, kQueuedMessages)),
      control_endpoint_(bind_listener(control_in_, config, "control")),
      bulk_endpoint_(bind_listener(bulk_in_, config, "bulk")) {}

std::string PeerLinks::routing_id() const { return routing_id_of(run_key_, config_.identity.rank, config_.incarnation); }

/// Events of a connection that ends.
SocketMonitor PeerLinks::watch(zmq::socket_t& socket) {
  return {context_, socket, ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_CLOSED, fmt::format("inproc://monitor-{}", ++num_monitors_)};
}

void PeerLinks::connect(int rank, const PeerAddress& to) {
  disconnect(rank);
  zmq::socket_t control = open_dialer(context_, routing_id(), linger_);
  security_.secure_dialer(control, to.public_key);
  const int interval_ms = static_cast<int>(config_.heartbeat.count());
  control.set(zmq::sockopt::heartbeat_ivl, interval_ms);
  control.set(zmq::sockopt::heartbeat_timeout, 4 * interval_ms);
  SocketMonitor monitor = watch(control);
  control.connect(to.endpoint);
  links_.emplace(rank, Link{std::move(control), std::move(monitor), std::nullopt});
}

void PeerLinks::disconnect(int rank) {
  links_.erase(rank);
  kept_.forget(rank);
}

void PeerLinks::connect_bulk(const PeerAddress& to, std::optional<std::uint32_t> epoch) {
  disconnect_bulk();
  // Its payloads are lent: they must come back when the caller leaves.
  bulk_out_ = open_dialer(context_, epoch ? fmt::format("{}.{}", routing_id(), *epoch) : routing_id(), milliseconds(0));
  security_.secure_dialer(bulk_out_, to.public_key);
  bulk_monitor_ = watch(bulk_out_);
  bulk_out_.connect(to.endpoint);
}

void PeerLinks::disconnect_bulk() {
  bulk_monitor_.reset();
  bulk_out_.close();
  bulk_lost_at_.reset();
}

bool PeerLinks::send(int rank, FrameHeader header, std::span<const std::byte> payload) {
  header.run_key = run_key_;
  header.length = payload.size();
  return send_message(links_.at(rank).control, header, zmq::message_t(payload.data(), payload.size()));
}

bool PeerLinks::send_bulk(FrameHeader header, std::span<const std::byte> payload) {
  header.run_key = run_key_;
  header.length = payload.size();
  return send_message(bulk_out_, header, lent_message(payload, lent_buffers_));
}

PeerLinks::SendResult PeerLinks::try_send(int rank, FrameHeader header, std::span<const std::byte> payload) {
  if (!is_connected(rank) || lost_at(rank)) return SendResult::no_connection;
  try {
    return send(rank, header, payload) ? SendResult::sent : SendResult::queue_full;
  } catch (const zmq::error_t&) {  // the connection is closing: the monitor will tell
    return SendResult::no_connection;
  }
}

void PeerLinks::send_notice(const PeerAddress& to, FrameHeader header, std::span<const std::byte> payload) {
  zmq::socket_t socket = open_dialer(context_, routing_id(), milliseconds(kNoticeLinger_ms));
  socket.set(zmq::sockopt::immediate, false);  // waits for the connection, as long as the socket lingers
  security_.secure_dialer(socket, to.public_key);
  socket.connect(to.endpoint);
  header.run_key = run_key_;
  header.length = payload.size();
  send_message(socket, header, zmq::message_t(payload.data(), payload.size()));
}

std::optional<PeerFrame> PeerLinks::receive(Plane plane, const std::function<Origin(PeerSender)>& origin_of) {
  zmq::socket_t& socket = plane == Plane::control ? control_in_ : bulk_in_;
  for (int unknown = 0; unknown < kUnknownAtOnce;) {
    std::optional<ReceivedMessage> message = receive_message(socket);
    if (!message) return std::nullopt;
    const PeerSender sender = sender_of(message->parts[0].to_string(), run_key_, config_.identity);
    const Origin origin = sender.rank < 0 ? Origin::unknown : origin_of(sender);
    if (origin == Origin::known) return frame_of(std::move(*message), sender.rank, run_key_);
    if (origin == Origin::late) continue;
    if (++unknown_peers_ == 1) log_warning(fmt::format("worker {} ignores messages of an unknown peer on its port", config_.identity.rank));
    ++unknown;
  }
  return std::nullopt;  // a flood: first see whether the peers are alive
}

void PeerLinks::read_monitors() {
  const auto now = Clock::now();
  for (auto& [rank, link] : links_)
    if (has_ended(link.monitor) && !link.lost_at) link.lost_at = now;
  if (bulk_monitor_ && has_ended(*bulk_monitor_) && !bulk_lost_at_) bulk_lost_at_ = now;
}

std::optional<PeerLinks::Clock::time_point> PeerLinks::lost_at(int rank) const {
  const auto found = links_.find(rank);
  return found == links_.end() ? std::nullopt : found->second.lost_at;
}

std::vector<int> PeerLinks::lost() const {
  std::vector<int> ranks;
  for (const auto& [rank, link] : links_)
    if (link.lost_at) ranks.push_back(rank);
  return ranks;
}

void PeerLinks::poll(const PeerInterest& interest, milliseconds longest) {
  poll_items_.clear();
  poll_items_.push_back({control_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_data) poll_items_.push_back({bulk_in_.handle(), 0, ZMQ_POLLIN, 0});
  if (interest.bulk_queue_full) poll_items_.push_back({bulk_out_.handle(), 0, ZMQ_POLLOUT, 0});
  for (const int rank : interest.full_control_queues) poll_items_.push_back({links_.at(rank).control.handle(), 0, ZMQ_POLLOUT, 0});
  for (auto& [rank, link] : links_)
    if (!link.lost_at) poll_items_.push_back({link.monitor.reader().handle(), 0, ZMQ_POLLIN, 0});
  if (bulk_monitor_ && !bulk_lost_at_) poll_items_.push_back({bulk_monitor_->reader().handle(), 0, ZMQ_POLLIN, 0});
  const long longest_ms = std::max<long>(0, static_cast<long>(longest.count()));
  if (zmq_poll(poll_items_.data(), static_cast<int>(poll_items_.size()), longest_ms) < 0 && zmq_errno() != EINTR) throw zmq::error_t();
  read_monitors();
}

void PeerLinks::wait_for_control(milliseconds longest) {
  zmq_pollitem_t item{control_in_.handle(), 0, ZMQ_POLLIN, 0};
  if (zmq_poll(&item, 1, static_cast<long>(longest.count())) < 0 && zmq_errno() != EINTR) throw zmq::error_t();
}

bool PeerLinks::wait_for_buffers(milliseconds longest) { return lent_buffers_.wait_until_empty(Clock::now() + longest); }

/// After a call no payload is lent, but libzmq may still hold encrypted copies that it has not sent.
void PeerLinks::extend_linger(Plane plane) {
  const int linger_ms = static_cast<int>(kFinalLinger.count());
  if (plane == Plane::control)
    for (auto& [rank, link] : links_) link.control.set(zmq::sockopt::linger, linger_ms);
  else if (bulk_out_)
    bulk_out_.set(zmq::sockopt::linger, linger_ms);
}

void PeerLinks::remove_listening_files() const {
  if (config_.incarnation == 0 || !config_.rendezvous.starts_with("ipc://")) return;
  for (const char* traffic : {"control", "bulk"}) ::unlink(listening_address(config_, traffic).substr(6).c_str());
}

void PeerLinks::close() {
  links_.clear();
  disconnect_bulk();
  bulk_in_.close();
  control_in_.close();
  gate_.reset();
  remove_listening_files();
  context_.close();  // waits until the I/O thread has dropped or sent everything: all lent payloads are back
}

}  // namespace earshot
