// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "evaluation/results/result.h"

namespace earshot {

/// Difference of two means of independent samples, first less second, from the mean and the 95 % interval of each, which may be skew: the
/// distances of the four limits add up as variances do (MOVER, Zou and Donner 2008, Statistics in Medicine 27, eq. 2).
Estimate independent_difference(const Estimate& first, const Estimate& second);

/// Results of a policy on the public set and on the private one.
struct PrivateScore {
  std::string agent;
  Estimate public_success, private_success, public_spl, private_spl;
  Estimate success_gap, spl_gap;  ///< public less private
  /// The public numbers are better than chance explains: the interval of a gap lies above zero.  Two metrics are looked at, so of policies
  /// without a gap up to one in twenty is flagged.
  [[nodiscard]] bool unexplained() const { return success_gap.low > 0 || spl_gap.low > 0; }
};

/// Pairs the results by agent, in the order of the public ones.  Throws InputError: a private result whose agent has no public one, is
/// another policy there (policy_hash), or has another private one.
std::vector<PrivateScore> private_scores(const std::vector<EvaluationResult>& public_results,
                                         const std::vector<EvaluationResult>& private_results);

/// As a table for a terminal.
std::string private_text(const std::vector<PrivateScore>& scores);

}  // namespace earshot
