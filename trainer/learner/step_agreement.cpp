// SPDX-License-Identifier: Apache-2.0
#include "trainer/learner/step_agreement.h"

#include <fmt/format.h>

#include <algorithm>

#include "sim/base/errors.h"
#include "sim/base/text/listed.h"
#include "trainer/net/wire.h"

namespace earshot {
namespace {

struct StatusMessage {
  static constexpr std::size_t kFields = 6;
  std::uint16_t version = kWireVersion;
  bool finite_here = true, finite_sum = true;
  std::uint64_t sum_hash = 0;
  double loss = 0, approx_kl = 0;
  MSGPACK_DEFINE(version, finite_here, finite_sum, sum_hash, loss, approx_kl)  // append fields, never reorder
};

StepStatus decode_status(std::size_t rank, const std::string& bytes) {
  try {
    const auto message = decode<StatusMessage>(bytes);
    return {message.finite_here, message.finite_sum, message.sum_hash, message.loss, message.approx_kl};
  } catch (const WireError& error) {
    throw protocol_breach(static_cast<int>(rank), error);
  }
}

template <class Predicate>
std::vector<int> find_ranks(std::span<const StepStatus> statuses, const Predicate& holds) {
  std::vector<int> ranks;
  for (std::size_t rank = 0; rank < statuses.size(); ++rank)
    if (holds(statuses[rank])) ranks.push_back(static_cast<int>(rank));
  return ranks;
}

}  // namespace

std::vector<StepStatus> exchange_status(const StepStatus& mine, Collective& collective) {
  if (collective.identity().world_size == 1) return {mine};
  const StatusMessage message{kWireVersion, mine.finite_here, mine.finite_sum, mine.sum_hash, mine.loss, mine.approx_kl};
  const auto messages = collective.all_gather(encode(message));
  std::vector<StepStatus> statuses;
  for (std::size_t rank = 0; rank < messages.size(); ++rank) statuses.push_back(decode_status(rank, messages[rank]));
  return statuses;
}

StepDecision decide(std::span<const StepStatus> statuses) {
  const auto faulty = find_ranks(statuses, [](const StepStatus& status) { return !status.finite_here; });
  if (!faulty.empty()) return {false, SkipCause::gradient, faulty};

  // Equal hash or equally not finite: NaN has many bit patterns, and which of them a sum keeps is the processor's business.
  const auto agrees = [](const StepStatus& a, const StepStatus& b) {
    return a.finite_sum == b.finite_sum && (!a.finite_sum || a.sum_hash == b.sum_hash);
  };
  std::vector<int> damaged;
  bool majority = false;
  for (const StepStatus& candidate : statuses) {
    const auto disagreeing = find_ranks(statuses, [&](const StepStatus& status) { return !agrees(status, candidate); });
    if (2 * disagreeing.size() < statuses.size()) {
      damaged = disagreeing;
      majority = true;
      break;
    }
  }
  if (!majority) damaged = find_ranks(statuses, [](const StepStatus&) { return true; });
  if (!damaged.empty()) return {false, SkipCause::message, damaged};
  const bool finite = std::ranges::all_of(statuses, &StepStatus::finite_sum);
  return {finite, SkipCause::sum, {}};
}

std::string describe(const SkippedStep& step) {
  const std::string faulty_workers = fmt::format("worker{} {}", step.faulty_ranks.size() == 1 ? "" : "s", listed(step.faulty_ranks, ", "));
  switch (step.cause) {
    case SkipCause::gradient:
      return fmt::format("the loss or gradient of {} is not finite", faulty_workers);
    case SkipCause::sum:
      return "all workers have finite gradients, but their sum is not finite: it overflowed, or a message was damaged";
    case SkipCause::message:
      return fmt::format("the sum received by {} was damaged in transit", faulty_workers);
  }
  return {};
}

}  // namespace earshot
