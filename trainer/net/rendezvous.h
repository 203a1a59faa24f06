// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "trainer/net/link_security.h"
#include "trainer/net/ring_config.h"

namespace earshot {

/// Checks identity and addresses before a socket is opened; asks no name server and opens no key file.  Throws InputError: rank or world
/// size out of
/// range, an address that is neither ipc:// in a folder that only its owner may enter nor tcp://, one that other hosts can reach without
/// keys (unless network.insecure), a path too long for a socket.
void validate(const RingConfig& config);

/// The config with the meeting point as numbers (host_address.h: asks until config.timeout is over).  ipc stays as it is.
RingConfig resolved(const RingConfig& config);

/// validate(), then resolved().
RingConfig prepared(const RingConfig& config);

/// Where this worker listens for one kind of traffic ("control", "bulk"): a file beside the rendezvous, or a port of the chosen interface
/// ("*": any).  config: resolved.
std::string listening_address(const RingConfig& config, const std::string& traffic);

/// Binds a listener there, at the first free port of network.port_range if there is one; returns the endpoint for the peers.  Throws
/// RunError.
std::string bind_listener(zmq::socket_t& socket, const RingConfig& config, const std::string& traffic);

/// Addresses of the workers, by rank.
struct PeerTable {
  std::uint64_t run_key = 0;  ///< fresh per start
  std::vector<std::string> control_endpoints, bulk_endpoints;
  std::vector<std::string> public_keys;  ///< empty texts without CURVE
  int refused = 0, garbage = 0;          ///< at rank 0: unknown peers turned away, messages that were none
};

/// Workers find each other: rank 0 listens at config.rendezvous, the others say hello with their endpoints, rank 0 answers all with the
/// table once all ranks are there.  A wrong run id, version, rank or world size is answered with the reason and disturbs no worker; garbage
/// is counted and dropped, and so are more than 100 unknown peers in a second.  Throws RunError: refused, or not all ranks came within
/// config.timeout (names those that are missing).  config: resolved; with keys, the gate of `security` is open.  meeting_socket: gets the
/// socket at which rank 0 listened.
PeerTable meet(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint,
               const LinkSecurity& security = {}, zmq::socket_t* meeting_socket = nullptr);

}  // namespace earshot
