// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/missing_energy.h"

#include <algorithm>
#include <cmath>

namespace earshot {

MissingEnergy missing_energy(std::span<const double> energy, double bin_s, double total) {
  const auto level_of = [&](double missing) { return 10.0 * std::log10(missing / total); };
  const std::size_t n = energy.size();
  const std::size_t window = std::max<std::size_t>(n / 10, std::min<std::size_t>(n, 3));
  const auto power = [&](std::size_t first) {
    double sum = 0;
    for (std::size_t i = first; i < first + window; ++i) sum += energy[i];
    return sum / (static_cast<double>(window) * bin_s);
  };
  const double last = power(n - window);
  if (!(last > 0)) return {};
  const std::size_t middle = std::min(n / 2, n - window);
  const double apart_s = static_cast<double>(n - window - middle) * bin_s;
  const double rate_per_s = apart_s > 0 ? std::log(power(middle) / last) / apart_s : 0.0;
  const double again = last * static_cast<double>(n) * bin_s;
  if (!(rate_per_s > 0)) return {level_of(again), false};
  const double at_end = last * std::exp(-0.5 * rate_per_s * static_cast<double>(window) * bin_s);
  return {level_of(std::min(at_end / rate_per_s, again)), true};
}

}  // namespace earshot
