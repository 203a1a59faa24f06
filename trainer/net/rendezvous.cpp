// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/rendezvous.h"

#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <filesystem>
#include <optional>

#include "sim/base/errors.h"
#include "sim/base/text/listed.h"
#include "trainer/net/host_address.h"
#include "trainer/net/meeting_sockets.h"
#include "trainer/net/wire.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaxSocketPath = 107;  // sockaddr_un::sun_path less its end mark
constexpr std::string_view kIpc = "ipc://", kTcp = "tcp://", kTaken = "is already taken";
constexpr int kRefusalsPerSecond = 100;  // requests above it go unanswered
constexpr int kReconnect_ms = 50, kReconnectMax_ms = 250;

std::string listening_path(const RingConfig& config, const std::string& traffic) {
  const std::string path = config.rendezvous.substr(kIpc.size());
  if (config.incarnation == 0) return fmt::format("{}.{}.{}", path, config.identity.rank, traffic);
  return fmt::format("{}.{}.{:08x}.{}", path, config.identity.rank, config.incarnation, traffic);
}

void check_private_folder(const RingConfig& config) {
  const std::filesystem::path socket = config.rendezvous.substr(kIpc.size());
  if (socket.empty() || config.rendezvous[kIpc.size()] == '@')
    throw InputError(config.rendezvous, "is not a path for a socket file", "write ipc:///FOLDER/NAME");
  if (listening_path(config, "control").size() > kMaxSocketPath)
    throw InputError(config.rendezvous, fmt::format("is too long for a socket file (at most {} characters)", kMaxSocketPath),
                     "use a shorter path, for example in /tmp");
  const std::filesystem::path folder = socket.has_parent_path() ? socket.parent_path() : ".";
  struct stat status {};
  if (::stat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode))
    throw InputError(folder.string(), "is not a folder", "create it with mode 0700");
  if (status.st_uid != ::geteuid() || (status.st_mode & 0077) != 0)
    throw InputError(folder.string(), "can be accessed by other users, who could join the run",
                     "run chmod 700 on it, or use a private folder");
}

/// Refusals of a worker whose launcher has started another number of workers meanwhile, or started this worker twice.
bool is_of_another_start(const std::string& refusal) { return refusal.starts_with(kOtherNumber) || refusal.ends_with(kTaken); }

/// Rank 0: collects the hellos.
class Host {
 public:
  Host(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint,
       const LinkSecurity& security)
      : config_(config),
        security_(security),
        socket_(open_meeting_socket(context, zmq::socket_type::router, config.rendezvous)),
        addresses_(static_cast<std::size_t>(config.identity.world_size)) {
    socket_.set(zmq::sockopt::router_mandatory, true);
    security.secure_listener(socket_);
    try {
      socket_.bind(meeting_address(config));
    } catch (const zmq::error_t& error) {
      throw InputError(config.rendezvous, fmt::format("cannot listen there: {}", error.what()),
                       "choose another address or port; rank 0 must run on that host");
    }
    table_.control_endpoints.resize(addresses_.size());
    table_.bulk_endpoints.resize(addresses_.size());
    table_.public_keys.resize(addresses_.size());
    table_.public_keys[0] = security.public_key();
    table_.control_endpoints[0] = control_endpoint;
    table_.bulk_endpoints[0] = bulk_endpoint;
    if (::getrandom(&table_.run_key, sizeof(table_.run_key), 0) != sizeof(table_.run_key))
      throw RunError("getrandom", "returned no random bytes");
  }

  /// The socket at which it listened.
  zmq::socket_t take_socket() { return std::move(socket_); }

  PeerTable run() {
    const auto deadline = Clock::now() + config_.timeout;
    while (!missing().empty()) {
      if (wait_readable(socket_, deadline) == Readable::none)
        throw WorldIncomplete(fmt::format("rendezvous {}", config_.rendezvous),
                              fmt::format("worker {} of {} did not connect within {} ms", listed(missing(), ", "),
                                          config_.identity.world_size, config_.timeout.count()));
      admit(receive_parts(socket_));
    }
    for (std::size_t rank = 1; rank < addresses_.size(); ++rank) {
      try {
        send(*addresses_[rank], acceptance());
      } catch (const zmq::error_t&) {
        throw WorldIncomplete(worker_name(static_cast<int>(rank)), "disconnected before the run started");
      }
    }
    return table_;
  }

 private:
  [[nodiscard]] Welcome acceptance() const {
    Welcome welcome;
    welcome.run_key = table_.run_key;
    welcome.control_endpoints = table_.control_endpoints;
    welcome.bulk_endpoints = table_.bulk_endpoints;
    welcome.public_keys = table_.public_keys;
    return welcome;
  }

  [[nodiscard]] std::vector<int> missing() const {
    std::vector<int> ranks;
    for (std::size_t rank = 1; rank < addresses_.size(); ++rank)
      if (!addresses_[rank]) ranks.push_back(static_cast<int>(rank));
    return ranks;
  }

  void admit(const std::vector<zmq::message_t>& parts) {
    if (parts.size() != 2) {
      ++table_.garbage;
      return;
    }
    Hello hello;
    try {
      hello = decode<Hello>(parts[1].to_string_view());
    } catch (const WireError& error) {
      ++table_.garbage;
      // A peer of another build waits for the reason; an unknown peer may read it too.
      refuse(parts[0], error.what());
      return;
    }
    const std::string reason = objection(hello, parts[1]);
    if (!reason.empty()) {
      ++table_.refused;
      refuse(parts[0], reason);
      return;
    }
    const auto rank = static_cast<std::size_t>(hello.rank);
    addresses_[rank] = parts[0].to_string();
    table_.control_endpoints[rank] = hello.control_endpoint;
    table_.bulk_endpoints[rank] = hello.bulk_endpoint;
    table_.public_keys[rank] = hello.public_key;
  }

  [[nodiscard]] std::string objection(const Hello& hello, const zmq::message_t& message) const {
    if (std::string reason = objection_to(hello, config_); !reason.empty()) return reason;
    if (addresses_[static_cast<std::size_t>(hello.rank)]) return fmt::format("rank {} {}", hello.rank, kTaken);
    return security_.objection_to(hello.public_key, message);
  }

  void refuse(const zmq::message_t& address, const std::string& reason) {
    const auto now = Clock::now();
    if (now - second_begins_ >= std::chrono::seconds(1)) {
      second_begins_ = now;
      refusals_ = 0;
    }
    if (++refusals_ > kRefusalsPerSecond) return;
    Welcome welcome;
    welcome.refusal = reason;
    try {
      send(address.to_string(), welcome);
    } catch (const zmq::error_t&) {  // gone already
    }
  }

  void send(const std::string& address, const Welcome& welcome) {
    socket_.send(zmq::buffer(address), zmq::send_flags::sndmore | zmq::send_flags::dontwait);
    socket_.send(zmq::buffer(encode(welcome)), zmq::send_flags::dontwait);
  }

  const RingConfig& config_;
  const LinkSecurity& security_;
  zmq::socket_t socket_;
  std::vector<std::optional<std::string>> addresses_;  // routing ids by rank
  PeerTable table_;
  Clock::time_point second_begins_;
  int refusals_ = 0;  // in the second that then began
};

PeerTable join(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint,
               const LinkSecurity& security) {
  const std::string where = fmt::format("rendezvous {}", config.rendezvous);
  zmq::socket_t socket = open_meeting_socket(context, zmq::socket_type::dealer, config.rendezvous);
  socket.set(zmq::sockopt::reconnect_ivl, kReconnect_ms);  // rank 0 may come up later than we do
  socket.set(zmq::sockopt::reconnect_ivl_max, kReconnectMax_ms);
  security.secure_dialer(socket, security.meeting_key());
  HandshakeMonitor handshakes(context, socket);
  try {
    socket.connect(config.rendezvous);
  } catch (const zmq::error_t& error) {
    throw InputError(config.rendezvous, fmt::format("cannot be connected to: {}", error.what()), "check the address");
  }
  Hello hello;
  hello.run_id = config.run_id;
  hello.rank = config.identity.rank;
  hello.world_size = config.identity.world_size;
  hello.control_endpoint = control_endpoint;
  hello.bulk_endpoint = bulk_endpoint;
  hello.public_key = security.public_key();
  socket.send(zmq::buffer(encode(hello)), zmq::send_flags::none);

  const auto deadline = Clock::now() + config.timeout;
  socket.set(zmq::sockopt::linger, 0);
  while (true) {
    const Readable readable = wait_readable(socket, deadline, &handshakes.socket());
    if (readable == Readable::first) break;
    if (readable == Readable::second) {
      handshakes.read(where, security);
      continue;
    }
    throw WorldIncomplete(where, fmt::format("worker 0 did not answer within {} ms, or not all workers connected", config.timeout.count()));
  }
  const auto parts = receive_parts(socket);
  try {
    if (parts.size() != 1) throw WireError("answer with several parts");
    Welcome welcome = decode<Welcome>(parts[0].to_string_view());
    if (!welcome.refusal.empty()) {
      const std::string problem = fmt::format("worker 0 refuses worker {}: {}", config.identity.rank, welcome.refusal);
      if (is_of_another_start(welcome.refusal)) throw WorldIncomplete(where, problem);
      throw RunError(where, problem);
    }
    const auto world_size = static_cast<std::size_t>(config.identity.world_size);
    if (welcome.control_endpoints.size() != world_size || welcome.bulk_endpoints.size() != world_size ||
        welcome.public_keys.size() != world_size)
      throw WireError("table of the wrong size");
    for (std::size_t rank = 0; rank < world_size; ++rank) {
      for (const auto* endpoints : {&welcome.control_endpoints, &welcome.bulk_endpoints}) {
        const std::string& endpoint = (*endpoints)[rank];
        if (!is_possible_endpoint(config, endpoint)) throw WireError("invalid worker endpoint");
      }
      const std::string& key = welcome.public_keys[rank];
      if (security.encrypted() ? !is_curve_key(key) : !key.empty()) throw WireError("invalid key");
    }
    return {welcome.run_key, std::move(welcome.control_endpoints), std::move(welcome.bulk_endpoints), std::move(welcome.public_keys), 0, 0};
  } catch (const WireError& error) {
    throw RunError(where, fmt::format("worker 0 uses another protocol: {}", error.what()));
  }
}

}  // namespace

void validate(const RingConfig& config) {
  const auto [rank, world_size] = config.identity;
  require(world_size >= 1 && world_size <= kMaxMeshWorkers, "world size", world_size,
          fmt::format("must be 1 to {} workers over ZeroMQ: more need network.collective=mpi or gloo", kMaxMeshWorkers));
  require(rank >= 0 && rank < world_size, "rank", rank, fmt::format("must be in 0 to {}", world_size - 1));
  require(config.run_id.size() <= 256, "run id", config.run_id.substr(0, 32), "must have at most 256 characters");
  require(config.timeout.count() > 0, "timeout", config.timeout.count(), "must be positive: every call has a time limit");
  require(config.heartbeat.count() > 0, "heartbeat", config.heartbeat.count(), "must be positive: it detects lost peers");
  require(config.incarnation == 0 || (world_size > 1 && config.network.on_loss == OnLoss::go_on), "network.on_loss", "stop",
          "must be continue, with more than one worker, for --join");
  if (world_size == 1) return;
  if (config.rendezvous.starts_with(kIpc)) {
    check_private_folder(config);
  } else if (config.rendezvous.starts_with(kTcp)) {
    require(parse_tcp(config.rendezvous).port > 0, "rendezvous", config.rendezvous,
            "must have a port: the workers connect to rank 0 there");
    validate(config.network);
    if (leaves_host(config.rendezvous) && config.network.curve_key_file.empty() && !config.network.insecure)
      throw InputError(config.rendezvous, "can be reached from other hosts, but no CURVE keys are set",
                       "make keys with 'earshot keys FILE' and set network.curve_key_file=FILE on all hosts, or use --insecure-network");
  } else {
    throw InputError(fmt::format("rendezvous '{}'", config.rendezvous), "is not an address", "write tcp://HOST:PORT or ipc:///FOLDER/NAME");
  }
}

RingConfig resolved(const RingConfig& config) {
  RingConfig result = config;
  if (!config.rendezvous.starts_with(kTcp)) return result;
  TcpAddress meeting_point = parse_tcp(config.rendezvous);
  meeting_point.host = resolve(meeting_point.host, Clock::now() + config.timeout);
  result.rendezvous = meeting_point.endpoint();
  return result;
}

RingConfig prepared(const RingConfig& config) {
  validate(config);
  return resolved(config);
}

std::string listening_address(const RingConfig& config, const std::string& traffic) {
  if (config.rendezvous.starts_with(kIpc)) return std::string(kIpc) + listening_path(config, traffic);
  const TcpAddress meeting_point = parse_tcp(config.rendezvous);
  const std::string& interface = config.network.interface;
  const bool loopback = is_loopback(meeting_point.host);
  if (interface.empty() || loopback) return TcpAddress{loopback ? meeting_point.host : local_address_towards(meeting_point), 0}.endpoint();
  return TcpAddress{address_of_interface(interface, meeting_point.host), 0}.endpoint();
}

std::string bind_listener(zmq::socket_t& socket, const RingConfig& config, const std::string& traffic) {
  const std::string address = listening_address(config, traffic);
  socket.set(zmq::sockopt::ipv6, address.find('[') != std::string::npos);
  const PortRange ports = address.starts_with(kTcp) ? ports_of(config.network) : PortRange{};
  std::string problem;
  for (int port = ports.first; port <= ports.last; ++port) {  // once, with port 0, without a range
    TcpAddress place;
    if (ports.first > 0) {
      if (port == parse_tcp(config.rendezvous).port) continue;  // rank 0's to take
      place = {parse_tcp(address).host, port};
    }
    try {
      socket.bind(ports.first > 0 ? place.endpoint() : address);
      return socket.get(zmq::sockopt::last_endpoint);
    } catch (const zmq::error_t& error) {
      problem = error.what();
      if (error.num() != EADDRINUSE) break;
    }
  }
  throw RunError(address, fmt::format("cannot listen there{}: {}",
                                      ports.first > 0 ? fmt::format(", ports {}-{}", ports.first, ports.last) : std::string(), problem));
}

PeerTable meet(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint,
               const LinkSecurity& security, zmq::socket_t* meeting_socket) {
  if (config.identity.rank == 0) {
    Host host(context, config, control_endpoint, bulk_endpoint, security);
    PeerTable table = host.run();
    if (meeting_socket != nullptr) *meeting_socket = host.take_socket();
    return table;
  }
  return join(context, config, control_endpoint, bulk_endpoint, security);
}

}  // namespace earshot
