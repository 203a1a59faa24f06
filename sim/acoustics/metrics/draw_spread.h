// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <optional>
#include <span>

#include "sim/acoustics/core/jackknife.h"

namespace earshot {

inline constexpr std::size_t kLeastDraws = 4;  ///< of fewer, twice the spread tells next to nothing of the error

/// Standard error of one of `values`, independent draws of the same quantity, from their own spread, times Student's over Gauss's quantile:
/// twice the error covers 95 % whatever their number.  nullopt of fewer than kLeastDraws.
inline std::optional<double> spread_of_draws(std::span<const double> values) {
  const std::optional<double> error = values.size() < kLeastDraws ? std::nullopt : error_of_mean(values);
  const auto n = static_cast<double>(values.size());
  return error ? std::optional(*error * std::sqrt(n) * student_factor(n - 1)) : std::nullopt;
}

}  // namespace earshot
