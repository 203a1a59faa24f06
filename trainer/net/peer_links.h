// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "sim/base/errors.h"
#include "trainer/net/link_security.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/socket_monitor.h"
#include "trainer/net/wire.h"

namespace earshot {

// Control messages that a listener takes in ahead of its reader.  libzmq 4.3.4 ends the process if a connection breaks while its reading is
// held up by a full queue and a heartbeat stands in its buffer (an assertion in stream_engine_base.cpp), so the queue must not fill: a
// reader that is away gets eight messages of progress until it counts as lost.
inline constexpr int kQueuedControl = 256;

/// Counts buffers that libzmq still reads.  Its I/O thread gives them back (docs/explanation/ppo.md, section 6.2: touching one earlier gave
/// wrong sums).  Safe from any thread.
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
  int from = 0;  ///< rank; place, where a PeerMesh hands it out
  FrameHeader header;
  zmq::message_t payload;
  [[nodiscard]] std::span<const std::byte> bytes() const { return {payload.data<const std::byte>(), payload.size()}; }
};

/// Condition that a call waits for.  Peers are named as by the one that is asked: places in a PeerMesh, ranks in PeerLinks.
struct PeerInterest {
  std::vector<int> full_control_queues;  ///< peers whose control queue was full
  bool bulk_queue_full = false, bulk_data = false;
  std::vector<int> awaited;  ///< peers without whose data the call cannot end
};

/// Sender of a message, from its routing id.
struct PeerSender {
  int rank = -1;                  ///< -1: unknown
  std::uint32_t incarnation = 0;  ///< which start of that rank
};

/// Where a peer listens, and the public key that it proves there (empty without CURVE).
struct PeerAddress {
  std::string endpoint, public_key;
};

/// Control messages that came before their call, per peer in the order in which they came.
class KeptFrames {
 public:
  void put(PeerFrame frame);
  /// The next one of that call, of the lowest rank that has one in front.
  std::optional<PeerFrame> take(std::uint32_t epoch, std::uint64_t sequence);
  /// Peers that have one of that call in front.
  [[nodiscard]] int num_peers(std::uint32_t epoch, std::uint64_t sequence) const;
  void drop_before(std::uint32_t epoch);
  void forget(int rank) { frames_.erase(rank); }

 private:
  std::map<int, std::deque<PeerFrame>> frames_;
};

/// The sockets of one worker, and its connections to all others, which are named by the ranks with which they began.  Two planes, so that a
/// gradient never stands in front of a goodbye message: control, to every peer, small; bulk, to one peer, in chunks that libzmq reads from
/// the caller's memory.  Each plane has one listening ROUTER; a connection is a DEALER whose routing id names the sender, watched by
/// libzmq's monitor.  A message has a header and a payload.  Queues for sending hold four messages.
///
/// Threads: all calls come from the one thread that owns the object.  Nothing waits but poll(), wait_for_control(), wait_for_buffers() and
/// close().  Errors: zmq::error_t where libzmq fails, RunError where a known peer breaks the protocol.
class PeerLinks {
 public:
  using Clock = std::chrono::steady_clock;
  enum class Plane { control, bulk };
  /// late: of an earlier start or view.  Dropped like a message of an unknown peer, but not counted as one.
  enum class Origin { known, late, unknown };
  enum class SendResult { sent, queue_full, no_connection };

  /// Binds both listeners.  config: validated and resolved; must outlive the object.  linger: longest time that unsent control messages
  /// delay close().  Throws InputError (keys), RunError (no port is free).
  PeerLinks(const RingConfig& config, std::chrono::milliseconds linger);

  [[nodiscard]] zmq::context_t& context() { return context_; }
  [[nodiscard]] const LinkSecurity& security() const { return security_; }
  /// Where this worker listens.
  [[nodiscard]] const std::string& endpoint(Plane plane) const { return plane == Plane::control ? control_endpoint_ : bulk_endpoint_; }
  /// Marks routing ids and messages as those of this run.  To be set before the first connection.
  void set_run_key(std::uint64_t run_key) { run_key_ = run_key; }

  /// Replaces the connection to that peer, if there is one, and forgets its kept messages.
  void connect(int rank, const PeerAddress& to);
  void disconnect(int rank);
  /// Replaces the connection for bulk messages.  epoch: becomes part of the routing id, as the listener may still have the connection of
  /// the last view under the other.
  void connect_bulk(const PeerAddress& to, std::optional<std::uint32_t> epoch);
  void disconnect_bulk();
  [[nodiscard]] bool is_connected(int rank) const { return links_.contains(rank); }

  /// False if the queue is full.  Control copies the payload; bulk lends it until wait_for_buffers() returns true.  Run key and length of
  /// the header are filled in.  The connection must be there.
  bool send(int rank, FrameHeader header, std::span<const std::byte> payload);
  bool send_bulk(FrameHeader header, std::span<const std::byte> payload);
  /// As send(), but a closed connection is not an error.
  SendResult try_send(int rank, FrameHeader header, std::span<const std::byte> payload);
  /// One message over a connection of its own, which stays for 2 s at most while it is made.
  void send_notice(const PeerAddress& to, FrameHeader header, std::span<const std::byte> payload);

  /// The next message of a known sender, or none yet.  origin_of: asked about each sender with a rank of another worker.  After 1,000
  /// messages of unknown peers in a row it returns none, so that the caller can look after its peers.
  std::optional<PeerFrame> receive(Plane plane, const std::function<Origin(PeerSender)>& origin_of);
  [[nodiscard]] KeptFrames& kept() { return kept_; }

  /// Notes which connections have ended.
  void read_monitors();
  /// When read_monitors() has seen that the connection broke; nullopt while it stands, or without a connection.
  [[nodiscard]] std::optional<Clock::time_point> lost_at(int rank) const;
  [[nodiscard]] const std::optional<Clock::time_point>& bulk_lost_at() const { return bulk_lost_at_; }
  /// Peers whose connection broke.
  [[nodiscard]] std::vector<int> lost() const;
  /// Returns after `longest`, or once a message has come, a queue of interest has room, a connection has ended, or a signal has come; then
  /// reads the monitors.
  void poll(const PeerInterest& interest, std::chrono::milliseconds longest);
  void wait_for_control(std::chrono::milliseconds longest);
  /// Whether libzmq reads none of the lent payloads any more, after `longest` at most.
  bool wait_for_buffers(std::chrono::milliseconds longest);

  /// Of a worker that ends after its last call: its messages get 5 s to leave, as the others may still need them.  Only a live peer that
  /// does not read delays the end that long.
  void extend_linger(Plane plane);
  /// Those of a worker that joins, which have names of their own: a rank may be started often.
  void remove_listening_files() const;
  /// Closes all sockets.  Returns when messages have left or been dropped, and all lent payloads are back.
  void close();
  /// Messages of unknown peers that were dropped, and peers whose keys were refused.
  [[nodiscard]] std::uint64_t unknown_peers() const { return unknown_peers_ + (gate_ ? gate_->refused() : 0); }

 private:
  struct Link {
    zmq::socket_t control;
    SocketMonitor monitor;
    std::optional<Clock::time_point> lost_at;
  };
  [[nodiscard]] std::string routing_id() const;
  [[nodiscard]] SocketMonitor watch(zmq::socket_t& socket);

  const RingConfig& config_;
  std::chrono::milliseconds linger_;
  BuffersInFlight lent_buffers_;  // outlives the context: its I/O thread gives buffers back
  zmq::context_t context_{1};
  LinkSecurity security_;
  std::unique_ptr<CurveGate> gate_;
  zmq::socket_t control_in_, bulk_in_, bulk_out_;
  std::optional<SocketMonitor> bulk_monitor_;
  std::string control_endpoint_, bulk_endpoint_;
  std::map<int, Link> links_;
  std::optional<Clock::time_point> bulk_lost_at_;
  KeptFrames kept_;
  std::vector<zmq_pollitem_t> poll_items_;
  std::uint64_t run_key_ = 0, unknown_peers_ = 0;
  int num_monitors_ = 0;
};

}  // namespace earshot
