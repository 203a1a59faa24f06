// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

namespace earshot {

/// Does a stated error of T20 cover the measured one?  A count over poses, each judged by the mean of its bands.
struct ErrorCoverage {
  int poses = 0, covered = 0;

  /// errors: relative, per band, NaN where the test has no value.  stated: one standard error of what is tested.  truth_errors: per band,
  /// standard errors of the truth, relative.  Covered: the mean size of the errors is at most twice the root of the sum of squares of both
  /// standard errors.  A pose without a band that can be compared is not counted.
  void add(std::span<const double> errors, double stated, std::span<const std::optional<double>> truth_errors);
};

}  // namespace earshot
