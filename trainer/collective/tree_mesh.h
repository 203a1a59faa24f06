// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <exception>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "trainer/net/liveness.h"
#include "trainer/net/peer_links.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/tree_shape.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Connections of one worker of many to its neighbours: in a tree (tree_shape.h) its parent and up to eight children, for control messages,
/// and in a ring the next rank, for bulk messages; 20 connections at most, whatever the number of workers.  All used by the one thread that
/// owns this object.  PeerLinks and Liveness are those of a PeerMesh, with other neighbours; a lost worker is always the end of the run.
///
/// A worker is connected to its neighbours only, which forward messages for all:
/// - a goodbye with a reason, to all other neighbours, with the rank that has stopped the run;
/// - progress: a message of progress says whether any worker on the sender's side of the tree has got on, and the deadline moves on;
/// - how many workers on the sender's side have begun the next call.
/// A neighbour that has begun the open call only waits for others.  So the neighbours of a missing worker name it; the other workers wait
/// for this report.
class TreeMesh {
 public:
  using Clock = std::chrono::steady_clock;

  /// Rendezvous and connections.  Throws InputError (config), RunError (a rank does not come, or refuses).
  explicit TreeMesh(const RingConfig& config);
  /// Sends the goodbye message, as finished or, while an exception passes through, as failed.
  ~TreeMesh();

  [[nodiscard]] WorkerIdentity identity() const { return config_.identity; }
  [[nodiscard]] const TreeNode& node() const { return node_; }
  /// Sender of bulk messages.
  [[nodiscard]] int left() const { return identity().left(); }
  [[nodiscard]] int right() const { return identity().right(); }
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
  /// Between two calls: number of other workers known to have begun call number `next`: up to 0.2 s later per
  /// level of the tree, or a step of a worker on the way.
  int num_waiting(std::uint64_t next);

  /// Ends the mesh: tells the neighbours why, or passes on what they have said, closes all sockets, takes back all lent payloads.  Later
  /// calls throw RunError with the same reason.
  void abandon(const std::string& reason);
  /// Messages of unknown peers that were dropped, and peers whose keys were refused.
  [[nodiscard]] std::uint64_t unknown_peers() const { return links_.unknown_peers(); }
  /// Connections to and from neighbours.
  [[nodiscard]] int num_connections() const { return 2 * static_cast<int>(neighbours_.size()) + 2; }

 private:
  struct Neighbour {
    int rank = 0;
    std::uint64_t begun = 0;  ///< calls that it has begun
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
  Neighbour* neighbour_of(int rank);
  std::optional<PeerFrame> receive_from(PeerLinks::Plane plane);
  void take_goodbye(const PeerFrame& frame);
  void take_progress(Neighbour& from, const FrameHeader& header);
  void check_neighbours();
  void check_deadline();
  void send_progress();
  [[nodiscard]] std::uint32_t num_begun_beside(const Neighbour& excepted) const;
  void look_around();

  RingConfig config_;  ///< resolved
  int exceptions_at_start_;
  TreeNode node_;
  PeerLinks links_;
  Liveness liveness_;  ///< its call: the open one, or the next
  std::vector<Neighbour> neighbours_;
  std::uint64_t announced_ = 0;  ///< calls of which the neighbours know that this worker has begun them
  Operation operation_ = Operation::barrier;
  bool is_open_ = false;
  bool counting_ = false;  ///< num_waiting() is in use
  Clock::time_point counts_sent_at_, looked_at_;
  std::optional<Stop> stopped_by_;  ///< another worker's goodbye
  std::optional<std::string> abandoned_;
  std::exception_ptr between_calls_;  ///< results of look_around()
};

}  // namespace earshot
