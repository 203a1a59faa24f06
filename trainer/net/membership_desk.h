// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "trainer/net/liveness.h"
#include "trainer/net/membership.h"
#include "trainer/net/peer_links.h"
#include "trainer/net/rendezvous.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

/// Where each worker of a run can be reached, and which start of a rank that is.  Plain values, no sockets.
class AddressBook {
 public:
  explicit AddressBook(const WorkerIdentity& own_identity)
      : own_identity_(own_identity), entries_(static_cast<std::size_t>(own_identity.world_size)) {}
  /// Of a worker that begins with the run.
  void set(PeerTable table) { table_ = std::move(table); }
  /// Of a worker that joins.
  void set(const JoinAnswer& answer);
  /// Another start of a rank.  was_member: whether the last one has taken part.
  void replace(const Candidate& candidate, bool was_member);

  [[nodiscard]] std::uint64_t run_key() const { return table_.run_key; }
  [[nodiscard]] PeerAddress control(int rank) const;
  [[nodiscard]] PeerAddress bulk(int rank) const;
  /// Whether it is of the start that is known here.
  [[nodiscard]] bool is_current(PeerSender sender) const;
  /// Address for telling a worker, of this start or the last one, that it is not a member; at most once a second per rank.
  std::optional<PeerAddress> take_notice_address(PeerSender sender);
  /// For workers that join; only the addresses are filled in.  incarnation: which start of its rank this worker is.
  [[nodiscard]] JoinAnswer listing(std::uint32_t incarnation) const;

 private:
  struct Entry {
    std::uint32_t incarnation = 0;
    PeerAddress former;  ///< of the last start that was a member
    std::chrono::steady_clock::time_point notified_at;
  };
  WorkerIdentity own_identity_;
  PeerTable table_;
  std::vector<Entry> entries_;  ///< by rank; the own entry does not change
};

/// Members of a run, as one of its workers knows them: the present view, and the way to the next one when a worker is lost or joins
/// (ViewAgreement).  It keeps the connections for control messages to all that take part or may do so next.
/// Workers are named by the ranks with which they began; the place of a member is its position among those that are left.
///
/// The owner reads the messages and brings those of views here.  To agree on a view it calls open_agreement(), then propose() and
/// is_settled() in turn until that is true, then adopt().  Used by the thread of `links`; no call waits.
class MembershipDesk {
 public:
  /// Thrown where a next view is due.
  struct Disruption {};
  /// Workers that left and joined with a view: empty after a broken connection.
  struct Change {
    std::vector<int> lost, joined;
  };
  /// config: resolved.  All references must outlive the object.
  MembershipDesk(const RingConfig& config, PeerLinks& links, Liveness& liveness);

  /// The first view, with all ranks.
  void start(PeerTable table);
  /// Of a worker that joins: the view that it is to leave with the members, for one with itself.
  void start_as_guest(const JoinAnswer& answer);
  /// This worker has joined for good: from now on it says goodbye, and an error of its own ends the run.
  void confirm_join() { is_guest_ = false; }
  /// False for a worker that is not in, or not yet: the run of the others is not its to end.
  [[nodiscard]] bool has_say() const { return !left_out_ && !is_guest_; }

  /// Place among those that are left, and their number.
  [[nodiscard]] WorkerIdentity identity() const { return identity_; }
  /// Ranks by place.
  [[nodiscard]] const std::vector<int>& members() const { return members_; }
  [[nodiscard]] int place_of(int rank) const;
  [[nodiscard]] const View& view() const { return views_->current(); }
  [[nodiscard]] const AddressBook& book() const { return book_; }
  /// The others that take part, or may do so in the next view.
  [[nodiscard]] std::vector<int> contacts() const;

  /// Whether messages of that start of a worker belong here.  Tells it so, at most once a second, if they do not: a worker that was left
  /// out has woken.
  PeerLinks::Origin admit_or_notify(PeerSender sender);
  /// The header with the open call and the present view.
  [[nodiscard]] FrameHeader stamped(FrameHeader header) const;

  /// Leaves out each member that is lost, and each of `awaited` that is silent.  Throws RunError instead where a lost worker is the end,
  /// and for a member that has said goodbye although another call is open.
  void check(const std::vector<int>& awaited);
  /// Whether a reason that this worker gives in its goodbye ends the run: not while it is left out, as it has stopped no more than itself.
  [[nodiscard]] bool heeds(int rank) const { return !is_regrouping_ || views_->proposal().has(rank); }
  /// Another worker's proposal.  Throws RunError where it breaks the protocol, LeftOut if it leaves this worker out.
  void take_view(const PeerFrame& frame);
  /// Whether a next view is due, and open_agreement() has not been called for it.
  [[nodiscard]] bool is_disrupted() const { return views_->is_open() && !is_regrouping_; }

  void open_agreement();
  [[nodiscard]] bool is_regrouping() const { return is_regrouping_; }
  /// Whether this worker has sent a proposal of the next view.
  [[nodiscard]] bool has_proposed() const { return sent_ != View{}; }
  /// Removes lost workers.  Whether enough are left.
  [[nodiscard]] bool has_quorum();
  /// Removes lost workers, and sends the proposal to all that have not received it.  Throws LeftOut if too few are left.
  void propose();
  /// Whether all members of the proposal have proposed it.  Throws LeftOut in a worker that joins and has been let wait for 10 s.
  [[nodiscard]] bool is_settled();
  /// The view that was decided, without connections to those that it leaves out; its first call is number 0.
  Change adopt();

  /// Joining workers, to which connections are opened; none of them is a member.  The next proposal begins with them.
  void expect(const std::vector<Candidate>& candidates);
  /// Makes a next view due, at first with the same members.
  void renew() { views_->renew(); }

 private:
  void connect(int rank);
  void set_members(std::vector<int> ranks);
  void lose(int rank, const std::string& problem);
  void drop_lost_peers();
  void send_proposals();

  const RingConfig& config_;
  PeerLinks& links_;
  Liveness& liveness_;
  AddressBook book_;
  std::optional<ViewAgreement> views_;
  WorkerIdentity identity_;
  std::vector<int> members_;
  bool is_guest_ = false;  ///< joins, and has not confirmed it
  bool left_out_ = false, is_regrouping_ = false;
  std::set<int> newcomers_;   ///< joining workers that have not been members yet
  std::set<int> uninformed_;  ///< peers that have not received the proposal
  View sent_;                 ///< the last proposal of this agreement
  Liveness::Clock::time_point agreement_began_;
};

}  // namespace earshot
