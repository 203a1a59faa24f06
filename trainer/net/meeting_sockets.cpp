// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/meeting_sockets.h"

#include <fmt/format.h>

#include <array>
#include <cerrno>

#include "sim/base/errors.h"
#include "trainer/net/host_address.h"
#include "trainer/net/wire.h"

namespace earshot {
namespace {

constexpr int kFailedHandshakes = 20;  // in a row: it is not a matter of rank 0 coming later

}  // namespace

zmq::socket_t open_meeting_socket(zmq::context_t& context, zmq::socket_type type, const std::string& address) {
  zmq::socket_t socket(context, type);
  socket.set(zmq::sockopt::ipv6, address.find('[') != std::string::npos);
  socket.set(zmq::sockopt::linger, 2000);  // the context outlives this socket: a table on its way still arrives
  socket.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(kMaxControlBytes));
  socket.set(zmq::sockopt::rcvhwm, 64);
  socket.set(zmq::sockopt::sndhwm, 64);
  return socket;
}

std::string meeting_address(const RingConfig& config) {
  if (!leaves_host(config.rendezvous) || config.network.interface.empty()) return config.rendezvous;
  const TcpAddress meeting_point = parse_tcp(config.rendezvous);
  return TcpAddress{address_of_interface(config.network.interface, meeting_point.host), meeting_point.port}.endpoint();
}

Readable wait_readable(zmq::socket_t& first, std::chrono::steady_clock::time_point deadline, zmq::socket_t* second) {
  while (true) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now()) + std::chrono::milliseconds(1);
    if (left.count() <= 0) return Readable::none;
    std::array<zmq_pollitem_t, 2> items{{{first.handle(), 0, ZMQ_POLLIN, 0}, {second ? second->handle() : nullptr, -1, ZMQ_POLLIN, 0}}};
    const int count = ::zmq_poll(items.data(), second ? 2 : 1, static_cast<long>(left.count()));
    if (count < 0 && ::zmq_errno() != EINTR) throw zmq::error_t();
    if (count <= 0) continue;
    return (items[0].revents & ZMQ_POLLIN) != 0 ? Readable::first : Readable::second;
  }
}

bool has_message(zmq::socket_t& socket) {
  try {
    return (socket.get(zmq::sockopt::events) & ZMQ_POLLIN) != 0;
  } catch (const zmq::error_t& error) {
    if (error.num() != EINTR) throw;
    return false;
  }
}

std::vector<zmq::message_t> receive_parts(zmq::socket_t& socket) {
  std::vector<zmq::message_t> parts;
  for (bool has_more = true; has_more;) {
    zmq::message_t part;
    try {
      if (!socket.recv(part, zmq::recv_flags::none)) break;
    } catch (const zmq::error_t& error) {
      if (error.num() != EINTR) throw;
      if (parts.empty()) break;
      continue;  // the rest of a message is there already
    }
    has_more = part.more();
    if (parts.size() < 3) parts.push_back(std::move(part));
  }
  return parts;
}

HandshakeMonitor::HandshakeMonitor(zmq::context_t& context, zmq::socket_t& socket)
    : monitor_(context, socket,
               ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH,
               "inproc://rendezvous.handshakes") {}

void HandshakeMonitor::read(const std::string& where, const LinkSecurity& security) {
  const auto event = monitor_.next();
  if (!event) return;
  ++failed_;
  if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)
    throw RunError(where, fmt::format("worker 0 does not accept the key {}; add the key to its network.allow_list", security.public_key()));
  // After another protocol, which another mechanism counts as, libzmq does not connect again.
  if (failed_ >= kFailedHandshakes || event == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL)
    throw RunError(where,
                   fmt::format("worker 0 and this worker do not have matching keys: {}",
                               security.encrypted() ? "network.meeting_key is not the public key of worker 0, or worker 0 has no keys"
                                                    : "worker 0 has keys, this worker has none"));
}

}  // namespace earshot
