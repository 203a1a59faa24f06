// SPDX-License-Identifier: Apache-2.0
#include "trainer/net/liveness.h"

#include <fmt/format.h>

#include <algorithm>

#include "sim/base/text/listed.h"

namespace earshot {

Goodbye decode_goodbye(const PeerFrame& frame) {
  try {
    return decode<Goodbye>(frame.payload.to_string_view());
  } catch (const WireError& error) {
    throw protocol_breach(frame.from, error);
  }
}

Liveness::Limits Liveness::limits_of(const RingConfig& config, std::chrono::milliseconds grace) {
  const double timeout_s = config.network.progress_timeout_s;
  return {config.timeout, std::chrono::milliseconds(static_cast<std::int64_t>(1000 * timeout_s)), grace,
          std::chrono::duration<double>(std::min(5.0, timeout_s / 8))};
}

Liveness::Liveness(const Limits& limits, const PeerLinks& links, int world_size)
    : limits_(limits), links_(links), peers_(static_cast<std::size_t>(world_size)) {}

void Liveness::begin(std::uint64_t call) {
  call_ = call;
  call_began_ = Clock::now();
  deadline_ = call_began_ + limits_.timeout;
}

std::chrono::milliseconds Liveness::time_left() const {
  return std::chrono::duration_cast<std::chrono::milliseconds>(deadline_ - Clock::now()) + std::chrono::milliseconds(1);
}

bool Liveness::is_gone(int rank) const {
  const auto lost_at = links_.lost_at(rank);
  return lost_at && Clock::now() - *lost_at >= limits_.grace;
}

bool Liveness::is_bulk_gone() const {
  const auto lost_at = links_.bulk_lost_at();
  return lost_at && Clock::now() - *lost_at >= 2 * limits_.grace;
}

bool Liveness::awaits_goodbye() const {
  return std::ranges::any_of(links_.lost(), [this](int rank) { return !finished_after(rank); });
}

Liveness::Clock::duration Liveness::silence(int rank, Clock::time_point since) const {
  return Clock::now() - std::max(peers_[static_cast<std::size_t>(rank)].heard_at, since);
}

std::string Liveness::describe_silence() const {
  return fmt::format("has made no progress for {} ms in or before collective call {}: it is stuck", limits_.patience.count(), call_);
}

WorldLost Liveness::has_left(int rank) const {
  return {worker_name(rank),
          fmt::format("has finished after {} collective calls, but this worker makes another call", finished_after(rank).value_or(0))};
}

WorldLost Liveness::missed(const std::vector<int>& ranks) const {
  return {fmt::format("worker {}", listed(ranks, ", ")),
          fmt::format("did not take part in collective call {} within {} ms", call_, limits_.timeout.count())};
}

}  // namespace earshot
