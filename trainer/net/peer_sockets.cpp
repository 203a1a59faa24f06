#include "trainer/net/peer_sockets.h"

#include <fmt/format.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <string_view>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::int64_t kCurveOverheadBytes = 64;  // libzmq compares the size of the sealed frame, 33 bytes more than its content
constexpr std::int64_t kMaxFrameBytes = static_cast<std::int64_t>(kChunkBytes) + kCurveOverheadBytes;

void give_back_buffer(void*, void* lent_buffers) { static_cast<BuffersInFlight*>(lent_buffers)->give_back(); }

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

zmq::socket_t open_listener(zmq::context_t& context, const LinkSecurity& security, int queued) {
  zmq::socket_t socket(context, zmq::socket_type::router);
  socket.set(zmq::sockopt::linger, 0);
  socket.set(zmq::sockopt::maxmsgsize, kMaxFrameBytes);
  socket.set(zmq::sockopt::rcvhwm, queued);
  security.secure_listener(socket);
  return socket;
}

zmq::socket_t open_dialer(zmq::context_t& context, const std::string& routing_id, std::chrono::milliseconds linger) {
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

zmq::socket_t monitor_of(zmq::context_t& context, zmq::socket_t& socket, const std::string& address) {
  if (zmq_socket_monitor(socket.handle(), address.c_str(), ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_CLOSED) != 0) throw zmq::error_t();
  zmq::socket_t events(context, zmq::socket_type::pair);
  events.set(zmq::sockopt::linger, 0);
  events.connect(address);
  return events;
}

bool has_ended(zmq::socket_t& monitor) {
  bool ended = false;
  zmq::message_t event;
  while (monitor.recv(event, zmq::recv_flags::dontwait)) {
    std::uint16_t number = 0;
    if (event.size() >= sizeof(number)) std::memcpy(&number, event.data(), sizeof(number));
    zmq::message_t address;
    if (event.more() && !monitor.recv(address, zmq::recv_flags::dontwait)) break;
    ended = ended || number == ZMQ_EVENT_DISCONNECTED || number == ZMQ_EVENT_CLOSED;
  }
  return ended;
}

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

zmq::message_t lent_message(std::span<const std::byte> payload, BuffersInFlight& buffers) {
  buffers.lend();
  // libzmq never writes to the payload; its interface only lacks the const.
  return {const_cast<std::byte*>(payload.data()), payload.size(), give_back_buffer, &buffers};
}

std::string routing_id_of(std::uint64_t run_key, int rank, std::uint32_t incarnation) {
  return fmt::format("E{:016x}.{}.{:08x}", run_key, rank, incarnation);
}

PeerSender sender_of(const std::string& routing_id, std::uint64_t run_key, WorkerIdentity own) {
  const std::string prefix = fmt::format("E{:016x}.", run_key);
  if (!routing_id.starts_with(prefix)) return {};
  const char* const end = routing_id.data() + routing_id.size();
  PeerSender sender;
  const auto [dot, error] = std::from_chars(routing_id.data() + prefix.size(), end, sender.rank);
  if (error != std::errc() || dot == end || *dot != '.') return {};
  if (sender.rank < 0 || sender.rank >= own.world_size || sender.rank == own.rank) return {};
  const auto [rest, no_incarnation] = std::from_chars(dot + 1, end, sender.incarnation, 16);
  if (no_incarnation != std::errc()) return {};
  if (rest == end) return sender;
  std::uint32_t epoch = 0;
  const auto [last, no_epoch] = std::from_chars(rest + 1, end, epoch);
  return *rest == '.' && no_epoch == std::errc() && last == end ? sender : PeerSender{};
}

std::optional<ReceivedMessage> receive_message(zmq::socket_t& socket) {
  ReceivedMessage message;
  bool more = true;
  while (more) {
    zmq::message_t surplus;
    zmq::message_t& part = message.count < message.parts.size() ? message.parts[message.count] : surplus;
    try {
      if (!socket.recv(part, zmq::recv_flags::dontwait)) return std::nullopt;
    } catch (const zmq::error_t& error) {
      if (error.num() == EINTR) continue;
      throw;
    }
    ++message.count;
    more = part.more();
  }
  return message;
}

PeerFrame frame_of(ReceivedMessage message, int from, std::uint64_t run_key) {
  PeerFrame frame;
  frame.from = from;
  auto& parts = message.parts;
  try {
    if (message.count != parts.size()) throw WireError(fmt::format("message of {} parts", message.count));
    frame.header = decode_header({parts[1].data<const std::byte>(), parts[1].size()});
    if (frame.header.run_key != run_key) throw WireError("frame of another run");
    if (frame.header.length != parts[2].size())
      throw WireError(fmt::format("{} bytes announced, {} sent", frame.header.length, parts[2].size()));
  } catch (const WireError& error) {
    throw RunError(fmt::format("worker {}", from), fmt::format("breaks the protocol: {}", error.what()));
  }
  frame.payload = std::move(parts[2]);
  return frame;
}

}  // namespace earshot
