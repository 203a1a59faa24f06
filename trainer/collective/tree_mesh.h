#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "trainer/net/link_security.h"
#include "trainer/net/peer_sockets.h"
#include "trainer/net/rendezvous.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/tree_shape.h"

namespace earshot {

/// Connections of one worker of many to its neighbours: in a tree (tree_shape.h) its parent and up to eight children, for control messages,
/// and in a ring the next rank, for bulk messages; 20 connections at most, whatever the number of workers.  All used by the one thread that
/// owns this object.  Sockets, keys and messages are those of a PeerMesh; a lost worker is always the end of the run.
///
/// No worker hears of all others, so that neighbours pass on what concerns all:
/// - a goodbye with a reason, to all other neighbours, with the rank that has stopped the run;
/// - progress: a message of progress says whether any worker on the sender's side of the tree has got on, and the deadline moves on;
/// - how many workers on the sender's side have begun the next call.
/// A neighbour that has begun the open call only waits for others.  So whoever is missing is named by its neighbours; the rest, whose
/// neighbours all wait, leave them the time to say so.
class TreeMesh {
 public:
  using Clock = std::chrono::steady_clock;

  /// Rendezvous and connections.  Throws InputError (config), RunError (a rank does not come, or refuses).
  explicit TreeMesh(const RingConfig& config);
  /// Sends the goodbye message, as finished or, while an exception passes through, as failed.
  ~TreeMesh();
  TreeMesh(const TreeMesh&) = delete;
  TreeMesh& operator=(const TreeMesh&) = delete;

  [[nodiscard]] WorkerIdentity identity() const { return config_.identity; }
  [[nodiscard]] const TreeNode& node() const { return node_; }
  /// From whom bulk messages come.
  [[nodiscard]] int left() const;
  [[nodiscard]] int right() const;
  [[nodiscard]] static int rank_of(int rank) { return rank; }

  /// Opens collective call number `sequence`: sets its deadline.
  void begin(std::uint64_t sequence, Operation operation);
  /// It is complete.
  void end();
  /// False when the queue is full; wait() then waits for room.  Control, to a neighbour in the tree, copies the payload; bulk, to the right
  /// one, lends it until finish_sends().
  bool send_control(int rank, FrameHeader header, std::span<const std::byte> payload);
  bool send_bulk(FrameHeader header, std::span<const std::byte> payload);
  /// The next message of the open call, or none yet.  A neighbour may be one call ahead: its messages are kept for that call.
  std::optional<PeerFrame> receive_control();
  std::optional<PeerFrame> receive_bulk();
  /// Blocks until something of interest may have changed.  Throws RunError: deadline, a dead neighbour, one that has left or another call.
  /// As every call needs all workers, all neighbours count as awaited.
  void wait(const PeerInterest& interest);
  /// Returns when libzmq reads none of the lent payloads any more.
  void finish_sends();

  /// Between two calls: tells the neighbours that this worker gets on, passes on what they say, at most ten times a second.  A lost
  /// neighbour or a stopped run is passed on at once, and thrown by the next call.
  void note_progress();
  /// Between two calls: how many other workers have begun call number `next`, as far as that has come to this one: up to 0.2 s later per
  /// level of the tree, or a step of a worker on the way.
  int num_waiting(std::uint64_t next);

  /// Ends the mesh: tells the neighbours why, or passes on what they have said, closes all sockets, takes back all lent payloads.  Later
  /// calls throw RunError with the same reason.
  void abandon(const std::string& reason);
  /// Messages of unknown peers that were dropped, and peers whose keys were refused.
  [[nodiscard]] std::uint64_t unknown_peers() const { return unknown_peers_ + (gate_ ? gate_->refused() : 0); }
  /// Connections to and from neighbours.
  [[nodiscard]] int num_connections() const { return 2 * static_cast<int>(neighbours_.size()) + 2; }

 private:
  struct Neighbour {
    int rank = 0;
    zmq::socket_t control, monitor;
    std::optional<Clock::time_point> lost_at;     ///< its connection broke
    std::optional<std::uint64_t> finished_after;  ///< its goodbye message came after that many calls
    Clock::time_point heard_at;                   ///< any message from its loop
    std::uint64_t begun = 0;                      ///< calls that it has begun
    std::deque<PeerFrame> early;                  ///< of the next call
    /// How many workers on one side of this edge have begun a call.
    struct Count {
      std::uint64_t call = 0;
      std::uint32_t workers = 0;
      friend bool operator==(const Count&, const Count&) = default;
    };
    Count heard, told;
    int counts_unanswered = 0;  ///< messages of progress since it was last heard
    bool progress_due = false;  ///< some worker on this side has got on since it was told
  };
  struct Stop {
    int rank = 0;
    std::string reason;
  };
  void connect(Neighbour& neighbour, const PeerTable& table);
  void connect_bulk(const PeerTable& table);
  Neighbour* neighbour_of(int rank);
  std::optional<PeerFrame> receive_from(zmq::socket_t& socket, bool bulk);
  void take_goodbye(const Neighbour& from, const PeerFrame& frame);
  void take_progress(Neighbour& from, const FrameHeader& header);
  void read_monitors();
  void check_neighbours();
  void check_deadline();
  void send_progress();
  [[nodiscard]] std::uint32_t num_begun_beside(const Neighbour& excepted) const;
  void look_around();
  void send_goodbye(const Stop& stop);
  void close_all();

  RingConfig config_;
  int exceptions_at_start_;
  TreeNode node_;
  BuffersInFlight lent_buffers_;  // outlives the context: its I/O thread gives buffers back
  zmq::context_t context_{1};
  LinkSecurity security_;
  std::unique_ptr<CurveGate> gate_;
  zmq::socket_t control_in_, bulk_in_, bulk_out_, bulk_monitor_;
  std::vector<Neighbour> neighbours_;
  std::optional<Clock::time_point> bulk_lost_at_;
  std::vector<zmq_pollitem_t> poll_items_;
  std::uint64_t run_key_ = 0, unknown_peers_ = 0;
  double progress_interval_s_ = 5;
  std::uint64_t call_ = 0;       ///< the open one, or the next
  std::uint64_t announced_ = 0;  ///< calls of which the neighbours know that this worker has begun them
  Operation operation_ = Operation::barrier;
  bool is_open_ = false;
  bool counting_ = false;  ///< num_waiting() is in use
  Clock::time_point call_began_, deadline_, progress_sent_at_, counts_sent_at_, looked_at_;
  std::optional<Stop> stopped_by_;  ///< another worker's goodbye
  std::optional<std::string> abandoned_;
  std::optional<RunError> between_calls_;  ///< what look_around() has found
};

}  // namespace earshot
