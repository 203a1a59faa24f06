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

#include "trainer/net/join_wire.h"
#include "trainer/net/link_security.h"
#include "trainer/net/meeting_point.h"
#include "trainer/net/membership.h"
#include "trainer/net/peer_sockets.h"
#include "trainer/net/rendezvous.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Sockets between the workers of one run, all used by the one thread that owns this object.  Two planes, so that a gradient never stands
/// in front of a goodbye message: control, from every worker to every other, small; bulk, only to the right neighbour, in chunks that
/// libzmq reads from the caller's memory. Each plane has one listening ROUTER per worker; the sender's routing id names it, any other
/// sender is counted and dropped.  Queues hold four messages.  A peer's death shows on the connection to it (at once when killed, after
/// four heartbeats when its machine or process hangs); that its loop hangs shows in the messages of progress that it no longer sends.
///
/// Where OnLoss::go_on is set a lost peer is a Disruption, after which regroup() finds those that are left.  Peers are named by their place
/// among these, 0 to identity().world_size - 1; messages name workers by the ranks with which they began.
class PeerMesh {
 public:
  using Clock = std::chrono::steady_clock;
  using Frame = PeerFrame;  ///< from: place
  using Interest = PeerInterest;

  /// Rendezvous and connections; of a worker that joins, once it is admitted.  Throws InputError (config), RunError (a rank does not come
  /// or refuses), LeftOut (another change of membership crossed the admission).
  explicit PeerMesh(const RingConfig& config);
  /// Sends the goodbye message, as finished or, while an exception passes through, as failed.
  ~PeerMesh();
  PeerMesh(const PeerMesh&) = delete;
  PeerMesh& operator=(const PeerMesh&) = delete;

  /// Place among those that are left, and their number.
  [[nodiscard]] WorkerIdentity identity() const { return identity_; }
  /// Ranks at the start, by place.
  [[nodiscard]] const std::vector<int>& members() const { return members_; }
  [[nodiscard]] int rank_of(int place) const { return members_[static_cast<std::size_t>(place)]; }
  [[nodiscard]] bool survives_loss() const { return config_.network.on_loss == OnLoss::go_on; }
  /// Whom bulk messages go to and come from: the neighbours by place, unless link_bulk() has said otherwise.
  [[nodiscard]] int right() const { return bulk_right_; }
  [[nodiscard]] int left() const { return bulk_left_; }
  /// Between two calls: makes another ring for bulk messages, until the membership changes.  The own place for both: no part in it.
  void link_bulk(int right, int left);

  /// Opens collective call number `sequence`: sets its deadline.
  void begin(std::uint64_t sequence);
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
  /// Whether calls send bulk messages.  Where none does, a broken bulk connection is no matter; regroup() opens all of them anew.
  void set_bulk_in_use(bool in_use) { bulk_in_use_ = in_use; }
  /// Thrown by the calls above where a peer is lost and the others are to go on: regroup() is then due.
  struct Disruption {};
  /// Agrees with the peers on who is left and who joins, and opens the connections among them.  Returns who has gone and come, by ranks at
  /// the start: none where a connection was broken.  Throws LeftOut: this worker was left out, or too few are left (ViewAgreement).
  struct Change {
    std::vector<int> lost, joined;
  };
  Change regroup();

  /// What workers that want to join are told.
  void brief(const std::string& text) { briefing_ = text; }
  /// At the worker that listens for them: those that are ready, encoded; else empty.
  std::string candidates();
  /// What that worker has found, on all members: the next view may have them.  Tells them so.  False if there are none.
  bool expect(const std::string& candidates);
  /// Once all members expect them: throws Disruption, so that regroup() agrees on a view with them.
  [[noreturn]] void invite();
  /// This worker has joined for good: from now on it says goodbye, and an error of its own ends the run.
  void confirm_join() { is_guest_ = false; }
  /// Tells the peers that this worker gets on: at most every 5 s, or eight times in the time after which it would count as lost.
  void note_progress();
  /// Between two calls: how many peers have sent control messages of call number `next`.
  int num_waiting(std::uint64_t next);
  /// Returns when libzmq reads none of the lent payloads any more.
  void finish_sends();

  /// Ends the mesh: tells the peers why, closes all sockets, takes back all lent payloads.  Later calls throw RunError with the same
  /// reason.
  void abandon(const std::string& reason);
  /// Messages of unknown peers that were dropped, and peers whose keys were refused.
  [[nodiscard]] std::uint64_t unknown_peers() const { return unknown_peers_ + (gate_ ? gate_->refused() : 0); }
  /// Messages of earlier views, or of workers that were left out, that were dropped.
  [[nodiscard]] std::uint64_t late_messages() const { return late_messages_; }

 private:
  struct Peer {
    zmq::socket_t control, monitor;
    std::uint32_t incarnation = 0;                ///< which start of that rank
    bool joins = false;                           ///< has not been a member yet
    std::optional<Clock::time_point> lost_at;     ///< its connection broke
    Clock::time_point told_at;                    ///< that it was left out, or an earlier start of it was
    std::optional<std::uint64_t> finished_after;  ///< its goodbye message came after that many calls
    Clock::time_point heard_at;                   ///< any message from its loop
    std::deque<Frame> early;                      ///< of the next call, or of the next view
    bool proposal_due = false;
    std::string former_endpoint, former_key;  ///< of the start before this one
  };
  // Ranks below are those at the start; so is Frame::from, until a frame is handed out.
  void connect(int rank);
  void connect_bulk();
  void set_members(std::vector<int> ranks);
  Peer& peer_at(int place) { return peers_[static_cast<std::size_t>(members_[static_cast<std::size_t>(place)])]; }
  [[nodiscard]] std::string routing_id() const;
  /// Ranks of the others that take part, or may do so in the next view.
  [[nodiscard]] std::vector<int> contacts() const;
  std::optional<Frame> receive_from(zmq::socket_t& socket);
  std::optional<Frame> handed_out(Frame frame) const;
  void tell_left_out(PeerSender sender);
  void take_goodbye(const Frame& frame);
  void take_view(const Frame& frame);
  void take_progress(const Frame& frame);
  void read_monitors();
  void check_peers(const std::vector<int>& awaited);
  void lose(int rank, const std::string& what);
  void send_progress(bool waiting);
  void send_proposals();
  void drop_lost_peers(Clock::time_point since);
  void join(const std::string& control_endpoint, const std::string& bulk_endpoint);
  void open_meeting_point();
  void look_at_meeting_point();
  Change adopt();
  bool send_to(int rank, FrameHeader header, std::span<const std::byte> payload);
  [[nodiscard]] LeftOut too_few() const;
  void let_messages_leave();
  void send_goodbye(const std::string& reason);
  void close_all();
  void remove_listening_files() const;

  RingConfig config_;
  int exceptions_at_start_;
  BuffersInFlight lent_buffers_;  // outlives the context: its I/O thread gives buffers back
  zmq::context_t context_{1};
  LinkSecurity security_;
  std::unique_ptr<CurveGate> gate_;
  zmq::socket_t control_in_, bulk_in_, bulk_out_, bulk_monitor_;
  PeerTable table_;
  std::vector<Peer> peers_;  // by rank at the start; the own place stays empty
  WorkerIdentity identity_;
  std::vector<int> members_;
  int bulk_right_ = 0, bulk_left_ = 0;  ///< places
  std::optional<ViewAgreement> views_;
  bool regrouping_ = false, peeking_ = false, left_out_ = false;
  bool is_guest_ = false;  ///< joins, and has not confirmed it
  int num_monitors_ = 0;
  int meeting_rank_ = 0;                         ///< who listens for workers that want to join
  zmq::socket_t meeting_socket_;                 ///< rank 0's of the rendezvous, until the meeting point has it
  std::unique_ptr<MeetingPoint> meeting_point_;  ///< of that worker
  std::string briefing_;
  std::deque<Frame> early_bulk_;  ///< of the next view
  std::optional<Clock::time_point> bulk_lost_at_;
  bool bulk_in_use_ = true;
  std::vector<zmq_pollitem_t> poll_items_;
  std::uint64_t run_key_ = 0, sequence_ = 0, unknown_peers_ = 0, late_messages_ = 0, progress_ = 0;
  std::chrono::milliseconds grace_;
  Clock::time_point call_began_, deadline_, progress_sent_at_;
  std::optional<std::string> abandoned_;
};

}  // namespace earshot
