// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/meeting_sockets.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <map>

#include "sim/base/errors.h"
#include "trainer/net/curve_keys.h"
#include "trainer/net/host_address.h"

namespace earshot {
namespace {

constexpr int kFailedHandshakes = 20;  // in a row: it is not a matter of rank 0 coming later

/// "ppo.clip is 0.1, that of the run is 0.2" of the first line that differs; empty where none does.
std::string difference(const std::string& theirs, const std::string& ours) {
  const auto lines = [](const std::string& text) {
    std::map<std::string, std::string> values;
    for (std::size_t begin = 0; begin < text.size();) {
      const std::size_t end = std::min(text.find('\n', begin), text.size()), equals = text.find('=', begin);
      if (equals < end) values[text.substr(begin, equals - begin)] = text.substr(equals + 1, end - equals - 1);
      begin = end + 1;
    }
    return values;
  };
  auto a = lines(theirs), b = lines(ours);
  for (const auto& [key, unused] : b) a.try_emplace(key, "(absent)");
  for (const auto& [key, value] : a) {
    const auto other = b.find(key);
    const std::string their_value = other == b.end() ? "(absent)" : other->second;
    if (value != their_value) return fmt::format("its {} is {:.60}, but the run has {:.60}", key, value, their_value);
  }
  return {};
}

/// The rules that Hello and JoinRequest share.  first: the lowest rank that may ask.
template <class Message>
std::string common_objection(const Message& message, const RingConfig& config, int first, const char* start) {
  const int world_size = config.identity.world_size;
  if (message.run_id != config.run_id) return "its run id belongs to another run";
  if (message.world_size != world_size)
    return fmt::format("{}{} workers, but this run {} {}", kOtherNumber, message.world_size, start, world_size);
  if (message.rank < first || message.rank >= world_size)
    return fmt::format("its rank {} is outside {} to {}", message.rank, first, world_size - 1);
  return {};
}

template <class Message>
bool has_possible_endpoints(const Message& message, const RingConfig& config) {
  return is_possible_endpoint(config, message.control_endpoint) && is_possible_endpoint(config, message.bulk_endpoint);
}

constexpr const char* kBadEndpoints = "its endpoints are not valid for workers of this run";

std::uint64_t bit(int rank) { return std::uint64_t{1} << rank; }

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

bool is_possible_endpoint(const RingConfig& config, const std::string& endpoint) {
  if (config.rendezvous.starts_with("ipc://"))
    return endpoint.starts_with(config.rendezvous + ".") && endpoint.find('/', config.rendezvous.size()) == std::string::npos;
  try {
    const TcpAddress address = parse_tcp(endpoint);
    return address.port > 0 && is_loopback(address.host) != leaves_host(config.rendezvous) && is_numeric_address(address.host);
  } catch (const InputError&) {
    return false;
  }
}

std::string objection_to(const Hello& hello, const RingConfig& config) {
  std::string reason = common_objection(hello, config, 1, "has");
  return reason.empty() && !has_possible_endpoints(hello, config) ? kBadEndpoints : reason;
}

std::string objection_to(const JoinRequest& request, const RingConfig& config) {
  if (std::string reason = common_objection(request, config, 0, "started with"); !reason.empty()) return reason;
  if (request.incarnation == 0) return "it was not started with --join";
  if (request.engine != config.engine) return fmt::format("its engine is {:.40}, but the run has {:.40}", request.engine, config.engine);
  if (std::string other = difference(request.settings, config.settings); !other.empty()) return other;
  return request.is_ready() && !has_possible_endpoints(request, config) ? kBadEndpoints : "";
}

void check(const JoinAnswer& admission, const RingConfig& config, bool encrypted) {
  const auto& [rank, world_size] = config.identity;
  for (const auto* texts : {&admission.control_endpoints, &admission.bulk_endpoints, &admission.public_keys})
    if (texts->size() != static_cast<std::size_t>(world_size)) throw WireError("table of the wrong size");
  if (admission.incarnations.size() != static_cast<std::size_t>(world_size)) throw WireError("table of the wrong size");
  const std::uint64_t world = world_size == 64 ? ~std::uint64_t{0} : bit(world_size) - 1, all = admission.members | admission.joining;
  if ((all & ~world) != 0 || admission.members == 0 || (admission.members & admission.joining) != 0 ||
      (admission.joining & bit(rank)) == 0 || admission.meeting_rank < 0 || admission.meeting_rank >= world_size ||
      (admission.members & bit(admission.meeting_rank)) == 0)
    throw WireError("invalid membership view");
  for (int other = 0; other < world_size; ++other) {
    if ((all & bit(other)) == 0) continue;
    const auto index = static_cast<std::size_t>(other);
    if (!is_possible_endpoint(config, admission.control_endpoints[index]) || !is_possible_endpoint(config, admission.bulk_endpoints[index]))
      throw WireError("invalid worker endpoint");
    if (encrypted ? !is_curve_key(admission.public_keys[index]) : !admission.public_keys[index].empty()) throw WireError("invalid key");
  }
}

void check(const CandidateList& list, const View& view, int world_size) {
  std::uint64_t joining = 0;
  for (const Candidate& candidate : list.candidates) {
    if (candidate.rank < 0 || candidate.rank >= world_size || view.has(candidate.rank) || (joining & bit(candidate.rank)) != 0)
      throw WireError("invalid candidate");
    joining |= bit(candidate.rank);
  }
}

}  // namespace earshot
