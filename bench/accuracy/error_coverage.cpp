// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/error_coverage.h"

#include <cmath>

namespace earshot {

void ErrorCoverage::add(std::span<const double> errors, double stated, std::span<const std::optional<double>> truth_errors) {
  double measured = 0, of_truth = 0;
  int bands = 0, known = 0;
  for (const double error : errors)
    if (!std::isnan(error)) measured += std::fabs(error), ++bands;
  for (const std::optional<double>& error : truth_errors)
    if (error) of_truth += *error, ++known;
  if (bands == 0) return;
  measured /= bands;
  if (known > 0) of_truth /= known;
  ++poses;
  covered += measured <= 2 * std::hypot(stated, of_truth) ? 1 : 0;
}

}  // namespace earshot
