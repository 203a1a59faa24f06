// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "policy/policy_network.h"
#include "trainer/collective/collective.h"
#include "trainer/held_out/held_out_state.h"

namespace earshot {

/// Evaluates the weights of a run on its held-out episodes.  Of one worker; the training is left as it is, to the last bit.
class HeldOutEvaluator {
 public:
  HeldOutEvaluator() = default;
  virtual ~HeldOutEvaluator() = default;
  HeldOutEvaluator(const HeldOutEvaluator&) = delete;
  HeldOutEvaluator& operator=(const HeldOutEvaluator&) = delete;

  /// What scores depend on beside the weights, as one word: the set, the batch, the actions that decide.
  [[nodiscard]] virtual const std::string& identity() const = 0;
  /// A collective call: the workers split the episodes, and all get the scores of all, which depend neither on their number nor on threads.
  /// Nothing, on every worker, where one has got a stop signal.
  [[nodiscard]] virtual std::optional<HeldOutScores> evaluate(const PolicyNetwork& policy, Collective& collective) = 0;
};

}  // namespace earshot
