// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "evaluation/results/result.h"

namespace earshot {

/// Two-sided p-value of the sign test: the chance that a fair coin falls as unevenly as `wins` to `losses` or more so; 1 for none of both.
/// Exact binomial tail, good to 1e-9 of its value.  O(min(wins, losses)).
double sign_test_p_value(std::uint64_t wins, std::uint64_t losses);

/// One metric of two agents on the same episodes.
struct PairedMetric {
  Estimate
      difference;  ///< first less second, with the interval of a bootstrap over scenes, or of episodes where that is wider or scenes few
  std::uint64_t wins = 0, losses = 0, ties = 0;  ///< of the first
  double p_value = 1;                            ///< sign_test_p_value: takes episodes as independent, which those of one scene are not
};
struct PairedComparison {
  PairedMetric success, spl;
};

/// Throws InputError if the two were not run on the same episodes.
PairedComparison compare_paired(const EvaluationResult& first, const EvaluationResult& second);
/// As a table for a terminal.
std::string comparison_text(const EvaluationResult& first, const EvaluationResult& second);

}  // namespace earshot
