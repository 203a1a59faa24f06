// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>
#include <zmq.hpp>

#include "trainer/net/link_security.h"
#include "trainer/net/membership.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

/// One member of a run under way listens for workers that want to join.  It answers each at once: refused with the reason (another version,
/// run id, world size, engine, config, a rank outside the world, endpoints where no worker listens, another key than it has proven), or it
/// has to wait, and what it has to know before.  No message here disturbs the run: invalid requests are dropped, more than 100
/// refusals in a second go unanswered, and one candidate is kept per rank that is not a member.
class MeetingPoint {
 public:
  /// socket: the one at which rank 0 met the others; without, address() is bound as soon as that works, and looked after: a worker that was
  /// left out may remove the file of an ipc address when it ends.  All references must outlive the object.
  MeetingPoint(zmq::context_t& context, const RingConfig& config, const LinkSecurity& security, const std::string& control_endpoint,
               zmq::socket_t socket = {});
  /// Tells those that wait that this run, or this worker's part in it, has ended.
  ~MeetingPoint();
  MeetingPoint(const MeetingPoint&) = delete;
  MeetingPoint& operator=(const MeetingPoint&) = delete;

  /// Where the others find it: the meeting point itself, or on another host its port at this worker's own address.
  [[nodiscard]] const std::string& address() const { return address_; }

  /// Reads and answers what has come, a bounded number of messages, at most every 20 ms.
  void look(const View& view, const std::string& briefing);
  /// Those that could be admitted: ready, heard of lately, and with a connection that stands.
  std::vector<Candidate> ready(const View& view, const std::string& briefing);
  /// They have been told; each asks anew if it comes to nothing.
  void admit(const std::vector<Candidate>& candidates, const JoinAnswer& answer);

 private:
  using Clock = std::chrono::steady_clock;
  struct Waiting {
    std::string routing_id;
    Candidate candidate;
    bool is_ready = false;
    Clock::time_point heard_at;
  };
  void open();
  void take(const std::vector<zmq::message_t>& parts, const View& view, const std::string& briefing);
  void refuse(const std::string& routing_id, const std::string& encoded);
  bool send(const std::string& routing_id, const std::string& encoded);

  zmq::context_t& context_;
  const RingConfig& config_;
  const LinkSecurity& security_;
  std::string address_;
  zmq::socket_t socket_;
  std::map<int, Waiting> waiting_;  ///< by rank
  Clock::time_point looked_at_, tried_at_, second_begins_;
  int refusals_ = 0;  ///< in the second that then began
  bool warned_ = false;
};

}  // namespace earshot
