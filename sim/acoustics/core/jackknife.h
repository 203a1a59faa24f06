#pragma once

#include <optional>
#include <span>

namespace earshot {

/// Standard error of a statistic from its values with one of n batches left out each: sqrt((n - 1) / n * sum of squared deviations)
/// (Tukey 1958).  nullopt if one of the values does not exist.
std::optional<double> jackknife_error(std::span<const std::optional<double>> values);

}  // namespace earshot
