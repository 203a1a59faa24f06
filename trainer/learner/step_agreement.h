// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "trainer/collective/collective.h"

namespace earshot {

/// One worker's status of an optimizer step before any worker takes it.
struct StepStatus {
  bool finite_here = true;         ///< its own loss and gradient, before they were summed
  bool finite_sum = true;          ///< the sum over workers as it reached this one
  std::uint64_t sum_hash = 0;      ///< of that sum's bits
  double loss = 0, approx_kl = 0;  ///< of its minibatch; 0 if it had no rows
};

/// The statuses of all workers, by rank; a collective call.  Throws RunError if a peer's message is malformed.
std::vector<StepStatus> exchange_status(const StepStatus& mine, Collective& collective);

/// Why no worker takes a step.
enum class SkipCause {
  gradient,  ///< the faulty ranks' own loss or gradient is not finite
  sum,       ///< all contributions are finite, but their sum is not, on any worker: it overflowed, or a message was damaged on its way in
  message    ///< the workers hold different sums: the data of the faulty ranks was damaged in transit
};

struct StepDecision {
  bool take = true;
  SkipCause cause = SkipCause::gradient;
  std::vector<int> faulty_ranks;  ///< ranks; empty for SkipCause::sum
};

/// A function of the statuses alone, so all workers decide alike.  A step is taken if every loss, every gradient and every sum is finite
/// and all sums have the same bits: then equal weights stay equal.  Among different sums those that most workers hold count as undamaged;
/// without a majority all ranks are faulty.
StepDecision decide(std::span<const StepStatus> statuses);

/// A step that no worker took.
struct SkippedStep {
  int epoch = 0, minibatch = 0;
  SkipCause cause = SkipCause::gradient;
  std::vector<int> faulty_ranks;
};
/// "the loss or gradient of worker 2 is not finite"
std::string describe(const SkippedStep& step);

}  // namespace earshot
