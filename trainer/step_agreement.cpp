#include "trainer/step_agreement.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace earshot {
namespace {

template <class Predicate>
std::vector<int> ranks_where(std::span<const StepVerdict> verdicts, const Predicate& holds) {
  std::vector<int> ranks;
  for (std::size_t rank = 0; rank < verdicts.size(); ++rank)
    if (holds(verdicts[rank])) ranks.push_back(static_cast<int>(rank));
  return ranks;
}

}  // namespace

StepDecision decide(std::span<const StepVerdict> verdicts) {
  const auto guilty = ranks_where(verdicts, [](const StepVerdict& verdict) { return !verdict.finite_here; });
  if (!guilty.empty()) return {false, SkipCause::gradient, guilty};

  // Equal hash or equally not finite: NaN has many bit patterns, and which of them a sum keeps is the processor's business.
  const auto same = [](const StepVerdict& a, const StepVerdict& b) {
    return a.finite_average == b.finite_average && (!a.finite_average || a.average_hash == b.average_hash);
  };
  std::vector<int> damaged;
  bool majority = false;
  for (const StepVerdict& candidate : verdicts) {
    const auto others = ranks_where(verdicts, [&](const StepVerdict& verdict) { return !same(verdict, candidate); });
    if (2 * others.size() < verdicts.size()) {
      damaged = others;
      majority = true;
      break;
    }
  }
  if (!majority) damaged = ranks_where(verdicts, [](const StepVerdict&) { return true; });
  if (!damaged.empty()) return {false, SkipCause::message, damaged};
  const bool finite = std::ranges::all_of(verdicts, &StepVerdict::finite_average);
  return {finite, SkipCause::sum, {}};
}

std::string describe(const SkippedStep& step) {
  const std::string who = fmt::format("worker{} {}", step.culprits.size() == 1 ? "" : "s", fmt::join(step.culprits, ", "));
  switch (step.cause) {
    case SkipCause::gradient:
      return fmt::format("the loss or gradient of {} is not finite", who);
    case SkipCause::sum:
      return "the gradients of all workers are finite, but not their average: it overflowed, or a message was damaged";
    case SkipCause::message:
      return fmt::format("the average that reached {} was damaged on its way", who);
  }
  return {};
}

}  // namespace earshot
