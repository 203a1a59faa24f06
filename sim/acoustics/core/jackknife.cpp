// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/jackknife.h"

#include <cmath>

namespace earshot {

std::optional<double> jackknife_error(std::span<const std::optional<double>> values) {
  if (values.empty()) return std::nullopt;
  const auto n = static_cast<double>(values.size());
  double mean = 0, squares = 0;
  for (const std::optional<double>& value : values) {
    if (!value) return std::nullopt;
    mean += *value / n;
  }
  for (const std::optional<double>& value : values) squares += (*value - mean) * (*value - mean);
  return std::sqrt((n - 1) / n * squares);
}

std::optional<double> error_of_mean(std::span<const double> values) {
  if (values.size() < 2) return std::nullopt;
  const auto n = static_cast<double>(values.size());
  double mean = 0, squares = 0;
  for (const double value : values) mean += value / n;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return std::sqrt(squares / (n - 1) / n);
}

double student_factor(double degrees) {
  constexpr double x = 1.959964, x3 = x * x * x, x5 = x3 * x * x, x7 = x5 * x * x, x9 = x7 * x * x;
  // One degree is Cauchy's distribution, cot(pi / 40); the expansion is 11 % short there.
  if (degrees < 1.5) return 12.70620 / x;
  // Abramowitz and Stegun 1964, 26.7.5.
  constexpr double terms[] = {(x3 + x) / 4, (5 * x5 + 16 * x3 + 3 * x) / 96, (3 * x7 + 19 * x5 + 17 * x3 - 15 * x) / 384,
                              (79 * x9 + 776 * x7 + 1482 * x5 - 1920 * x3 - 945 * x) / 92160};
  double factor = 0, power = 1;
  for (const double term : terms) factor += term / (power *= degrees);
  return 1 + factor / x;
}

}  // namespace earshot
