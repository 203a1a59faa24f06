// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>
#include <zmq.hpp>

#include "trainer/net/link_security.h"
#include "trainer/net/membership.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/socket_monitor.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Shared by both ends of a meeting point: that of the start (rendezvous.cpp) and that of a run under way (meeting_point.h).

/// A socket for control messages between workers that do not know each other yet.
zmq::socket_t open_meeting_socket(zmq::context_t& context, zmq::socket_type type, const std::string& address);

/// Where rank 0 listens: at the meeting point, or at its port of the interface that was chosen (the others may know the host by another
/// address).
std::string meeting_address(const RingConfig& config);

enum class Readable { none, first, second };
/// Which of two sockets has something to read before the deadline.
Readable wait_readable(zmq::socket_t& first, std::chrono::steady_clock::time_point deadline, zmq::socket_t* second = nullptr);

/// Whether a message is there.  Never waits; a signal that comes meanwhile reads as none.
bool has_message(zmq::socket_t& socket);

/// The parts of the next message, three at most: enough to see that it is not ours.  None where a signal ends the wait for it.
std::vector<zmq::message_t> receive_parts(zmq::socket_t& socket);

/// Handshakes of one socket that failed, by libzmq's monitor.
class HandshakeMonitor {
 public:
  HandshakeMonitor(zmq::context_t& context, zmq::socket_t& socket);
  [[nodiscard]] zmq::socket_t& socket() { return monitor_.reader(); }
  /// Reads the next event, if one has come; throws RunError if the other end refuses the key, or after too many failures.
  void read(const std::string& where, const LinkSecurity& security);

 private:
  SocketMonitor monitor_;
  int failed_ = 0;
};

/// Rules for messages between workers that are not connected yet: functions of the message and the config alone.  The proof of a key is
/// LinkSecurity's.

/// Whether a worker may listen there: an endpoint in a message may only lead where this worker would listen itself.
[[nodiscard]] bool is_possible_endpoint(const RingConfig& config, const std::string& endpoint);

/// Begin of the reason where a worker expects another number of workers.
inline constexpr std::string_view kOtherNumber = "it expects ";
/// The reason to refuse a worker of the first world, or one that joins; empty if there is none.
[[nodiscard]] std::string objection_to(const Hello& hello, const RingConfig& config);
[[nodiscard]] std::string objection_to(const JoinRequest& request, const RingConfig& config);

/// Throw WireError for an admission of this worker that breaks the protocol, and for candidates that are members or are no ranks of the
/// run.
void check(const JoinAnswer& admission, const RingConfig& config, bool encrypted);
void check(const CandidateList& list, const View& view, int world_size);

}  // namespace earshot
