// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "trainer/net/admission_desk.h"
#include "trainer/net/liveness.h"
#include "trainer/net/membership_desk.h"
#include "trainer/net/peer_links.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Messages between the workers of one run for its collective calls, which all workers make in the same order.  Every worker has a
/// connection for control messages to every other, and one for bulk messages to its right neighbour.  PeerLinks holds the sockets, Liveness
/// watches the peers, MembershipDesk knows the members, AdmissionDesk admits workers; this class puts messages in the order of the
/// calls and decides when a call ends in an error.
///
/// With OnLoss::go_on a lost peer is a Disruption, after which regroup() finds the remaining ones.  Peers are named by their place
/// among these, 0 to identity().world_size - 1; messages name workers by the ranks with which they began.
///
/// Threads: all calls come from the one thread that owns the object.
class PeerMesh {
 public:
  using Frame = PeerFrame;  ///< from: place
  using Interest = PeerInterest;
  using Change = MembershipDesk::Change;
  /// Thrown by the calls below where a peer is lost, or one joins, and the others are to go on: regroup() is then due.
  using Disruption = MembershipDesk::Disruption;

  /// Rendezvous and connections; of a worker that joins, once it is admitted.  Throws InputError (config), RunError (a rank does not come
  /// or refuses), LeftOut (another change of membership crossed the admission).
  explicit PeerMesh(const RingConfig& config);
  /// Sends the goodbye message, as finished or, while an exception passes through, as failed: by the last change of members, if the owner
  /// has made no call since, as it then ends for that reason.
  ~PeerMesh();

  /// Place among those that are left, and their number.
  [[nodiscard]] WorkerIdentity identity() const { return membership_.identity(); }
  /// Ranks at the start, by place.
  [[nodiscard]] const std::vector<int>& members() const { return membership_.members(); }
  [[nodiscard]] int rank_of(int place) const { return members()[static_cast<std::size_t>(place)]; }
  /// Workers that want to join, and what this one does until it has joined for good.
  [[nodiscard]] AdmissionDesk& admissions() { return admissions_; }

  /// Receiver and sender of bulk messages: the neighbours by place, unless link_bulk() has said otherwise.
  [[nodiscard]] int right() const { return bulk_right_; }
  [[nodiscard]] int left() const { return bulk_left_; }
  /// Between two calls: makes another ring for bulk messages, until the membership changes.  The own place for both: no part in it.
  void link_bulk(int right, int left);
  /// Whether calls send bulk messages.  Where none does, a broken bulk connection is no matter; regroup() opens all of them anew.
  void set_bulk_in_use(bool in_use) { bulk_in_use_ = in_use; }

  /// Opens collective call number `sequence`: sets its deadline.  is_barrier: it brings no bytes of the others.
  void begin(std::uint64_t sequence, bool is_barrier = false);
  /// A peer has finished after the open call, a barrier: it was the last call of the run, and all workers have come to it.
  [[nodiscard]] bool is_run_over() const { return is_run_over_; }
  /// False when the peer's queue is full; wait() then waits for room.  Control copies the payload; bulk lends it until finish_sends().
  bool send_control(int peer, FrameHeader header, std::span<const std::byte> payload);
  bool send_bulk(FrameHeader header, std::span<const std::byte> payload);
  /// The next message of the open call, or none yet.  A peer may be one call ahead: its control messages are kept for that call.
  std::optional<Frame> receive_control();
  std::optional<Frame> receive_bulk();
  /// Blocks until something of interest may have changed.  Throws RunError: deadline, a dead peer, a peer that has left or stopped the run.
  void wait(const Interest& interest);
  /// For a caller that waits for a worker elsewhere than on sockets: throws what wait() would.
  void check(int awaited);
  /// Returns when libzmq reads none of the lent payloads any more.
  void finish_sends();

  /// Agrees with the peers on the remaining and joining members, and opens the connections among them.  Returns the workers that left and
  /// joined, by ranks at the start: empty after a broken connection.  Nothing if is_run_over() and the others need this worker no more.
  /// Throws LeftOut: this worker was left out, or too few are left (ViewAgreement).
  std::optional<Change> regroup();

  /// Tells the peers that this worker gets on: at most every 5 s, or eight times in the time after which it would count as lost.
  void note_progress();
  /// Between two calls: number of peers that have sent control messages of call number `next`.
  int num_waiting(std::uint64_t next);

  /// Ends the mesh: tells the peers why, closes all sockets, takes back all lent payloads.  Without a reason, as finished, it waits for the
  /// goodbyes of the others, 2 s at most.  Later calls throw RunError with the same reason.
  void abandon(const std::string& reason);
  /// Messages of unknown peers that were dropped, and peers whose keys were refused.
  [[nodiscard]] std::uint64_t unknown_peers() const { return links_.unknown_peers(); }
  /// Messages of earlier views, or of workers that were left out, that were dropped.
  [[nodiscard]] std::uint64_t late_messages() const { return late_messages_; }

 private:
  void connect_bulk(int right, int left);
  std::optional<Frame> receive_from(PeerLinks::Plane plane);
  void check_peers(const std::vector<int>& awaited);
  void send_progress(bool waiting);
  void await_goodbyes();

  RingConfig config_;  ///< resolved
  int exceptions_at_start_;
  PeerLinks links_;
  Liveness liveness_;
  MembershipDesk membership_;
  AdmissionDesk admissions_;
  int bulk_right_ = 0, bulk_left_ = 0;  ///< places
  bool bulk_in_use_ = true;
  bool is_barrier_ = false, is_run_over_ = false;  ///< of the open call
  bool is_between_calls_ = false;                  ///< a change of membership is the next call's business
  std::deque<Frame> early_bulk_;                   ///< of the next view
  Interest interest_by_rank_;                      ///< of wait()
  std::uint64_t late_messages_ = 0, progress_ = 0;
  std::string last_change_;  ///< that no call has followed yet
  std::optional<std::string> abandoned_;
};

}  // namespace earshot
