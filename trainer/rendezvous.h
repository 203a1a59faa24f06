#pragma once

#include <cstdint>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "trainer/collective.h"

namespace earshot {

/// Checks who and where before a socket is opened.  Throws InputError: rank or world size out of range, an address that is neither ipc://
/// in a folder that only its owner may enter nor tcp:// on the loopback interface (others would need CURVE authentication), a path too long
/// for a socket.
void validate(const RingConfig& config);

/// Where this worker listens for one kind of traffic ("control", "bulk"): a file beside the rendezvous, or any free loopback port.
std::string listening_address(const RingConfig& config, const std::string& traffic);

/// Who can be reached where, by rank.
struct PeerTable {
  std::uint64_t run_key = 0;  ///< fresh per start
  std::vector<std::string> control_endpoints, bulk_endpoints;
  int refused = 0, garbage = 0;  ///< at rank 0: unknown peers turned away, messages that were none
};

/// Workers find each other: rank 0 listens at config.rendezvous, the others say hello with their endpoints, rank 0 answers all with the
/// table once all ranks are there.  A wrong run id, version, rank or world size is answered with the reason and disturbs no worker; garbage
/// is counted and dropped. Throws RunError: refused, or not all ranks came within config.timeout (names those that are missing).
PeerTable meet(zmq::context_t& context, const RingConfig& config, const std::string& control_endpoint, const std::string& bulk_endpoint);

}  // namespace earshot
