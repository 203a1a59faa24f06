#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "trainer/net/link_security.h"
#include "trainer/net/wire.h"

namespace earshot {

/// What connections between workers have in common, whether each knows all (peer_mesh.h) or only its neighbours in a tree (tree_mesh.h):
/// one listening ROUTER per plane, a DEALER to each peer whose routing id names the sender, messages of a header and a payload.

// Control messages that a listener takes in ahead of its reader.  libzmq 4.3.4 ends the process if a connection breaks while its reading is
// held up by a full queue and a heartbeat stands in its buffer (an assertion in stream_engine_base.cpp), so the queue must not fill: a
// reader that is away gets eight messages of progress until it counts as lost.
inline constexpr int kQueuedControl = 256;
inline constexpr int kQueuedMessages = 4;            ///< per peer and direction: at most 4 MiB wait
inline constexpr int kUnknownAtOnce = 1000;          ///< messages of unknown peers that are dropped before anything else is looked at again
inline constexpr std::size_t kMaxReasonBytes = 600;  ///< of a goodbye message
/// How long a worker that ends after its last call waits for its messages to leave; the others may still need them.  Only a live peer that
/// does not read delays the end that long.
inline constexpr std::chrono::milliseconds kFinalLinger{5000};

/// Counts buffers that libzmq still reads.  Its I/O thread gives them back (docs/ppo.md, section 6.2: touching one earlier gave wrong
/// sums).
class BuffersInFlight {
 public:
  void lend();
  void give_back();
  /// False if some are still out at the deadline.
  bool wait_until_empty(std::chrono::steady_clock::time_point deadline);

 private:
  std::mutex mutex_;
  std::condition_variable empty_;
  int count_ = 0;
};

struct PeerFrame {
  int from = 0;  ///< place in a mesh, rank in a tree
  FrameHeader header;
  zmq::message_t payload;
  [[nodiscard]] std::span<const std::byte> bytes() const { return {payload.data<const std::byte>(), payload.size()}; }
};

/// What a call waits for.
struct PeerInterest {
  std::vector<int> full_control_queues;  ///< peers whose control queue was full
  bool bulk_queue_full = false, bulk_data = false;
  std::vector<int> awaited;  ///< peers without whose data the call cannot end
};

/// queued: messages that it takes in ahead of its reader, per peer.
zmq::socket_t open_listener(zmq::context_t& context, const LinkSecurity& security, int queued);
/// linger: how long messages that have not left hold up the end.
zmq::socket_t open_dialer(zmq::context_t& context, const std::string& routing_id, std::chrono::milliseconds linger);

/// Events of a connection that ends.  address: an inproc:// name of its own.
zmq::socket_t monitor_of(zmq::context_t& context, zmq::socket_t& socket, const std::string& address);
/// Whether it tells of an end.  Reads all that there is.
bool has_ended(zmq::socket_t& monitor);

/// Header and payload as one message of two parts; false if the queue is full.
bool send_message(zmq::socket_t& socket, const FrameHeader& header, zmq::message_t payload);
/// A payload that is read from the caller's memory until it is given back.  A message that is not sent gives it back at once.
zmq::message_t lent_message(std::span<const std::byte> payload, BuffersInFlight& buffers);

/// A worker names itself to listeners.  Another id for each start of a rank: a listener may still have the connections of the start before.
std::string routing_id_of(std::uint64_t run_key, int rank, std::uint32_t incarnation);
struct PeerSender {
  int rank = -1;  ///< -1: unknown
  std::uint32_t incarnation = 0;
};
/// Whose routing id this is; one may end with "." and a number.
PeerSender sender_of(const std::string& routing_id, std::uint64_t run_key, WorkerIdentity own);

/// The next message of a listener, if one has come: routing id, header, payload where it is one of ours.
struct ReceivedMessage {
  std::array<zmq::message_t, 3> parts;
  std::size_t count = 0;  ///< may be more: those are dropped
};
std::optional<ReceivedMessage> receive_message(zmq::socket_t& socket);
/// Throws RunError where it breaks the protocol.
PeerFrame frame_of(ReceivedMessage message, int from, std::uint64_t run_key);

}  // namespace earshot
