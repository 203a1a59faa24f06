#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace earshot {

/// What one worker has to say about one optimizer step before anybody takes it.
struct StepVerdict {
  bool finite_here = true;         ///< its own loss and gradient, before they were averaged
  bool finite_average = true;      ///< the average as it reached this worker
  std::uint64_t average_hash = 0;  ///< of that average's bits
  double loss = 0, approx_kl = 0;  ///< of its minibatch; 0 if it had no rows
};

/// Everybody's verdict at everybody, by rank.
using ExchangeVerdicts = std::function<std::vector<StepVerdict>(const StepVerdict& mine)>;

/// Why no worker takes a step.
enum class SkipCause {
  gradient,  ///< the culprits' own loss or gradient is not finite
  sum,  ///< all contributions are finite, but their average is not, on any worker: the sum overflowed, or a message was damaged on its way
        ///< in
  message  ///< the workers hold different averages: what reached the culprits was damaged on its way
};

struct StepDecision {
  bool take = true;
  SkipCause cause = SkipCause::gradient;
  std::vector<int> culprits;  ///< ranks; empty for SkipCause::sum
};

/// A function of the verdicts alone, so all workers decide alike.  A step is taken if every loss, every gradient and every average is
/// finite and all averages have the same bits: then equal weights stay equal.  Among different averages those that most workers hold count
/// as undamaged; without a majority all are culprits.
StepDecision decide(std::span<const StepVerdict> verdicts);

/// A step that no worker took.
struct SkippedStep {
  int epoch = 0, minibatch = 0;
  SkipCause cause = SkipCause::gradient;
  std::vector<int> culprits;
};
/// "the loss or gradient of worker 2 is not finite"
std::string describe(const SkippedStep& step);

}  // namespace earshot
