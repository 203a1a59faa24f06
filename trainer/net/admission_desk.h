// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <zmq.hpp>

#include "trainer/net/meeting_point.h"
#include "trainer/net/membership_desk.h"
#include "trainer/net/peer_links.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

/// How workers come to a run under way.  One member, at first rank 0, listens for them (MeetingPoint) and finds those that are ready; all
/// members are told of them (expect), and only then is the next view due (invite).  The worker that joins asks to be admitted.
///
/// Used by the thread of `links`; no call waits but ask().
class AdmissionDesk {
 public:
  /// config: resolved.  All references must outlive the object.
  AdmissionDesk(const RingConfig& config, PeerLinks& links, MembershipDesk& desk);

  /// Of a worker that joins: asks until the members are about to let it in.  Throws InputError (refused), RunError (no answer).
  JoinAnswer ask();

  /// Opens the meeting point, if this worker is the one that listens, members survive a loss, and it is not open yet.  socket: the one at
  /// which rank 0 met the others; empty later on.
  void listen(zmq::socket_t socket);
  /// After a change of view: where the worker that listened has gone, the first member of both views takes over.
  void follow(const MembershipDesk::Change& change);
  /// Reads and answers what has come to the meeting point, at most every 20 ms.
  void look();
  /// Tells those that wait that they will not be let in.
  void close() { meeting_point_.reset(); }

  /// Answers to workers that want to join.
  void brief(const std::string& text) { briefing_ = text; }
  /// At the worker that listens for them: those that are ready, encoded; else empty.
  [[nodiscard]] std::string candidates();
  /// What that worker has found, on all members: the next view may have them.  Tells them so.  False if there are none.  Throws RunError
  /// for invalid candidates.
  bool expect(const std::string& candidates);
  /// Once all members expect them: throws MembershipDesk::Disruption, so that all agree on a view with them.
  [[noreturn]] void invite();
  /// This worker has joined for good: from now on it says goodbye, and an error of its own ends the run.
  void confirm() { desk_.confirm_join(); }

 private:
  [[nodiscard]] CandidateList decode_candidates(const std::string& text) const;
  void admit(const CandidateList& list);

  const RingConfig& config_;
  PeerLinks& links_;
  MembershipDesk& desk_;
  int meeting_rank_ = 0;                         ///< rank that listens for workers that want to join
  std::unique_ptr<MeetingPoint> meeting_point_;  ///< of that worker
  std::string briefing_;
};

}  // namespace earshot
