#include "trainer/rendezvous.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <optional>

#include "sim/base/errors.h"
#include "trainer/wire.h"

namespace earshot {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kMaxWorkers = 64;
constexpr std::size_t kMaxSocketPath = 107;  // sockaddr_un::sun_path less its end mark
constexpr std::string_view kIpc = "ipc://", kTcp = "tcp://";

std::string listening_path(const RingConfig& config, const std::string& traffic) {
  return fmt::format("{}.{}.{}", config.rendezvous.substr(kIpc.size()), config.identity.rank, traffic);
}

bool is_loopback(std::string_view address) {
  if (!address.starts_with(kTcp)) return false;
  const std::string_view host = address.substr(kTcp.size(), address.rfind(':') - kTcp.size());
  return host == "127.0.0.1" || host == "localhost";
}

/// A peer's endpoint comes from a message: it may only lead where we would listen ourselves.
bool is_local_endpoint(const RingConfig& config, const std::string& endpoint) {
  if (config.rendezvous.starts_with(kIpc))
    return endpoint.starts_with(config.rendezvous + ".") && endpoint.find('/', config.rendezvous.size()) == std::string::npos;
  return is_loopback(endpoint);
}

void check_private_folder(const RingConfig& config) {
  const std::filesystem::path socket = config.rendezvous.substr(kIpc.size());
  if (socket.empty() || config.rendezvous[kIpc.size()] == '@')
    throw InputError(config.rendezvous, "is not the path of a socket file", "write ipc:///FOLDER/NAME");
  if (listening_path(config, "control").size() > kMaxSocketPath)
    throw InputError(config.rendezvous, fmt::format("is too long for a socket file ({} characters at most)", kMaxSocketPath),
                     "use a shorter folder, in /tmp for example");
  const std::filesystem::path folder = socket.has_parent_path() ? socket.parent_path() : ".";
  struct stat status {};
  if (::stat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode))
    throw InputError(folder.string(), "is no folder", "create it for the rendezvous, mode 0700");
  if (status.st_uid != ::geteuid() || (status.st_mode & 0077) != 0)
    throw InputError(folder.string(), "is open to other users, who could join the run there", "chmod 700, or take a folder of your own");
}

zmq::socket_t open_socket(zmq::context_t& context, zmq::socket_type type) {
  zmq::socket_t socket(context, type);
  socket.set(zmq::sockopt::linger, 2000);  // the context outlives this socket: a table on its way still arrives
  socket.set(zmq::sockopt::maxmsgsize, static_cast<std::int64_t>(kMaxControlBytes));
  socket.set(zmq::sockopt::rcvhwm, 64);
  socket.set(zmq::sockopt::sndhwm, 64);
  return socket;
}

/// True when there is something to read before the deadline.
bool wait_readable(zmq::socket_t& socket, Clock::time_point deadline) {
  while (true) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()) + std::chrono::milliseconds(1);
    if (left.count() <= 0) return false;
    zmq_pollitem_t item{socket.handle(), 0, ZMQ_POLLIN, 0};
    const int count = zmq_poll(&item, 1, static_cast<long>(left.count()));
    if (count > 0) return true;
    if (count < 0 && zmq_errno() != EINTR) throw zmq::error_t();
  }
}

std::vector<zmq::message_t> receive_parts(zmq::socket_t& socket) {
  std::vector<zmq::message_t> parts;
  do {
    zmq::message_t part;
    if (!socket.recv(part, zmq::recv_flags::none)) break;
    if (parts.size() < 3) parts.push_back(std::move(part));  // enough to see that it is not ours
  } while (socket.get(zmq::sockopt::rcvmore));
  return parts;
}

/// Rank 0: collects the hellos.
class Host {
 public:
  Host(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint)
      : config_(config),
        socket_(open_socket(context, zmq::socket_type::router)),
        addresses_(static_cast<std::size_t>(config.identity.world_size)) {
    socket_.set(zmq::sockopt::router_mandatory, true);
    try {
      socket_.bind(config.rendezvous);
    } catch (const zmq::error_t& error) {
      throw InputError(config.rendezvous, fmt::format("cannot listen there: {}", error.what()), "choose another address or port");
    }
    table_.control_endpoints.resize(addresses_.size());
    table_.bulk_endpoints.resize(addresses_.size());
    table_.control_endpoints[0] = control_endpoint;
    table_.bulk_endpoints[0] = bulk_endpoint;
    if (::getrandom(&table_.run_key, sizeof(table_.run_key), 0) != sizeof(table_.run_key)) throw RunError("getrandom", "gives no bytes");
  }

  PeerTable run() {
    const auto deadline = Clock::now() + config_.timeout;
    while (!missing().empty()) {
      if (!wait_readable(socket_, deadline))
        throw RunError(fmt::format("rendezvous {}", config_.rendezvous),
                       fmt::format("worker {} of {} did not come within {} ms", fmt::join(missing(), ", "), config_.identity.world_size,
                                   config_.timeout.count()));
      admit(receive_parts(socket_));
    }
    Welcome welcome;
    welcome.run_key = table_.run_key;
    welcome.control_endpoints = table_.control_endpoints;
    welcome.bulk_endpoints = table_.bulk_endpoints;
    for (std::size_t rank = 1; rank < addresses_.size(); ++rank) {
      try {
        send(*addresses_[rank], welcome);
      } catch (const zmq::error_t&) {
        throw RunError(fmt::format("worker {}", rank), "left before the run began");
      }
    }
    return table_;
  }

 private:
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
    const std::string reason = objection(hello);
    if (!reason.empty()) {
      ++table_.refused;
      refuse(parts[0], reason);
      return;
    }
    const auto rank = static_cast<std::size_t>(hello.rank);
    addresses_[rank] = parts[0].to_string();
    table_.control_endpoints[rank] = hello.control_endpoint;
    table_.bulk_endpoints[rank] = hello.bulk_endpoint;
  }

  [[nodiscard]] std::string objection(const Hello& hello) const {
    const int world_size = config_.identity.world_size;
    if (hello.run_id != config_.run_id) return "its run id is that of another run";
    if (hello.world_size != world_size) return fmt::format("it expects {} workers, this run has {}", hello.world_size, world_size);
    if (hello.rank < 1 || hello.rank >= world_size) return fmt::format("its rank {} is not within 1 to {}", hello.rank, world_size - 1);
    if (addresses_[static_cast<std::size_t>(hello.rank)]) return fmt::format("rank {} is taken", hello.rank);
    if (!is_local_endpoint(config_, hello.control_endpoint) || !is_local_endpoint(config_, hello.bulk_endpoint))
      return "its endpoints are not local ones";
    return {};
  }

  void refuse(const zmq::message_t& address, const std::string& reason) {
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
  zmq::socket_t socket_;
  std::vector<std::optional<std::string>> addresses_;  // routing ids by rank
  PeerTable table_;
};

PeerTable join(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint) {
  const std::string where = fmt::format("rendezvous {}", config.rendezvous);
  zmq::socket_t socket = open_socket(context, zmq::socket_type::dealer);
  socket.set(zmq::sockopt::reconnect_ivl, 50);  // rank 0 may come up later than we do
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
  socket.send(zmq::buffer(encode(hello)), zmq::send_flags::none);

  if (!wait_readable(socket, Clock::now() + config.timeout)) {
    socket.set(zmq::sockopt::linger, 0);
    throw RunError(where, fmt::format("worker 0 did not answer within {} ms, or not all workers came", config.timeout.count()));
  }
  const auto parts = receive_parts(socket);
  try {
    if (parts.size() != 1) throw WireError("answer of several parts");
    Welcome welcome = decode<Welcome>(parts[0].to_string_view());
    if (!welcome.refusal.empty())
      throw RunError(where, fmt::format("worker 0 refuses worker {}: {}", config.identity.rank, welcome.refusal));
    const auto world_size = static_cast<std::size_t>(config.identity.world_size);
    if (welcome.control_endpoints.size() != world_size || welcome.bulk_endpoints.size() != world_size)
      throw WireError("table of another size");
    for (const auto* endpoints : {&welcome.control_endpoints, &welcome.bulk_endpoints})
      for (const auto& endpoint : *endpoints)
        if (!is_local_endpoint(config, endpoint)) throw WireError("endpoint that is not local");
    return {welcome.run_key, std::move(welcome.control_endpoints), std::move(welcome.bulk_endpoints), 0, 0};
  } catch (const WireError& error) {
    throw RunError(where, fmt::format("worker 0 speaks another protocol: {}", error.what()));
  }
}

}  // namespace

void validate(const RingConfig& config) {
  const auto [rank, world_size] = config.identity;
  require(world_size >= 1 && world_size <= kMaxWorkers, "world size", world_size, "must be 1 to 64 workers");
  require(rank >= 0 && rank < world_size, "rank", rank, fmt::format("must be within 0 to {}", world_size - 1));
  require(config.run_id.size() <= 256, "run id", config.run_id.substr(0, 32), "must have at most 256 characters");
  require(config.timeout.count() > 0, "timeout", config.timeout.count(), "must be positive: no call waits for ever");
  require(config.heartbeat.count() > 0, "heartbeat", config.heartbeat.count(), "must be positive: it is how a dead peer is noticed");
  if (world_size == 1) return;
  if (config.rendezvous.starts_with(kIpc)) {
    check_private_folder(config);
  } else if (config.rendezvous.starts_with(kTcp)) {
    if (!is_loopback(config.rendezvous))
      throw InputError(config.rendezvous,
                       "is not on the loopback interface; that needs CURVE authentication, which this build does not have",
                       "use tcp://127.0.0.1:PORT or ipc:///FOLDER/NAME and keep the workers on one host");
  } else {
    throw InputError(fmt::format("rendezvous '{}'", config.rendezvous), "is not an address",
                     "write tcp://127.0.0.1:PORT or ipc:///FOLDER/NAME");
  }
}

std::string listening_address(const RingConfig& config, const std::string& traffic) {
  if (config.rendezvous.starts_with(kIpc)) return std::string(kIpc) + listening_path(config, traffic);
  return "tcp://127.0.0.1:*";
}

PeerTable meet(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint) {
  if (config.identity.rank == 0) return Host(context, config, control_endpoint, bulk_endpoint).run();
  return join(context, config, control_endpoint, bulk_endpoint);
}

}  // namespace earshot
