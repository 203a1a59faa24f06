// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

namespace earshot {

/// Standard error of a statistic from its values with one of n batches left out each: sqrt((n - 1) / n * sum of squared deviations)
/// (Tukey 1958).  nullopt if one of the values does not exist.
std::optional<double> jackknife_error(std::span<const std::optional<double>> values);

/// Standard error of the mean of independent values, from their own spread.  nullopt of fewer than two.
std::optional<double> error_of_mean(std::span<const double> values);

/// Quantile of 97.5 % of Student's distribution over that of Gauss: twice a standard error with so many degrees of freedom (one less than
/// the values that it was estimated from), times this, covers 95 %.  Within 1 %; degrees >= 1.
double student_factor(double degrees);

}  // namespace earshot
