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

}  // namespace earshot
