// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/process/exit_codes.h"
#include "trainer/net/peer_links.h"
#include "trainer/net/ring_config.h"
#include "trainer/net/wire.h"

namespace earshot {

inline constexpr std::size_t kMaxReasonBytes = 600;  ///< of a goodbye message

/// The goodbye message in a frame.  Throws RunError for another frame.
Goodbye decode_goodbye(const PeerFrame& frame);

/// The open collective call of one worker, and whether its peers get on with it: each has sent a message lately, its connection stands or
/// broke just now, it has not said goodbye.  A peer's death shows on the connection to it (at once when killed, after four heartbeats when
/// its machine or process hangs); that its loop hangs shows in the messages of progress that it no longer sends.
///
/// It only keeps times; the owner asks, sends and throws.  Peers are named by rank.  Used by the thread of `links`; no call waits.
class Liveness {
 public:
  using Clock = std::chrono::steady_clock;
  struct Limits {
    std::chrono::milliseconds timeout;                ///< of one call in which no worker makes progress
    std::chrono::milliseconds patience;               ///< with a worker from which no message comes
    std::chrono::milliseconds grace;                  ///< for a goodbye message to arrive after its connection broke
    std::chrono::duration<double> progress_interval;  ///< between messages of progress
  };
  /// Messages of progress every 5 s, or eight times in the time after which a worker counts as lost.
  [[nodiscard]] static Limits limits_of(const RingConfig& config, std::chrono::milliseconds grace);
  /// links: must outlive the object.
  Liveness(const Limits& limits, const PeerLinks& links, int world_size);

  /// Opens call number `call`: it has a timeout from now on.
  void begin(std::uint64_t call);
  /// Between two calls.
  void set_call(std::uint64_t call) { call_ = call; }
  [[nodiscard]] std::uint64_t call() const { return call_; }
  [[nodiscard]] Clock::time_point call_began() const { return call_began_; }
  /// A worker has got on: the call has another timeout from now on.
  void prolong() { deadline_ = Clock::now() + limits_.timeout; }
  [[nodiscard]] Clock::time_point deadline() const { return deadline_; }
  /// To the deadline, rounded up to milliseconds; below 1 once it has passed.
  [[nodiscard]] std::chrono::milliseconds time_left() const;

  /// There is a new connection to that peer.
  void greet(int rank) { peer(rank) = {Clock::now(), std::nullopt}; }
  /// A message of its loop has come.
  void hear(int rank) { peer(rank).heard_at = Clock::now(); }
  /// Its goodbye message has come, after that many calls.
  void finish(int rank, std::uint64_t num_calls) { peer(rank).finished_after = num_calls; }
  [[nodiscard]] const std::optional<std::uint64_t>& finished_after(int rank) const {
    return peers_[static_cast<std::size_t>(rank)].finished_after;
  }
  /// Its connection broke, and a goodbye message would have come by now.
  [[nodiscard]] bool is_gone(int rank) const;
  /// The same for the connection for bulk messages, with twice the time.
  [[nodiscard]] bool is_bulk_gone() const;
  /// Whether a connection broke whose peer may still say goodbye.
  [[nodiscard]] bool awaits_goodbye() const;
  /// Time since the last message of that peer, since `since` at most.
  [[nodiscard]] Clock::duration silence(int rank, Clock::time_point since) const;
  [[nodiscard]] bool is_silent(int rank) const { return silence(rank, call_began_) >= limits_.patience; }

  [[nodiscard]] bool is_progress_due() const { return Clock::now() - progress_sent_at_ >= limits_.progress_interval; }
  void note_progress_sent() { progress_sent_at_ = Clock::now(); }

  /// Why a peer counts as lost, as errors and log lines say it.
  [[nodiscard]] std::string describe_silence() const;
  /// The error of a peer that has said goodbye although another call is open.
  [[nodiscard]] WorldLost has_left(int rank) const;
  /// The error of peers that the call has awaited to its deadline.
  [[nodiscard]] WorldLost missed(const std::vector<int>& ranks) const;

 private:
  struct Peer {
    Clock::time_point heard_at = Clock::time_point::min();  ///< never
    std::optional<std::uint64_t> finished_after;
  };
  Peer& peer(int rank) { return peers_[static_cast<std::size_t>(rank)]; }

  Limits limits_;
  const PeerLinks& links_;
  std::vector<Peer> peers_;  ///< by rank
  std::uint64_t call_ = 0;
  Clock::time_point call_began_, deadline_, progress_sent_at_;
};

}  // namespace earshot
