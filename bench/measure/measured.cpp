// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/measured.h"

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {

Measured median_of(std::vector<double> values) {
  require(!values.empty(), "values", values.size(), "a median needs at least one");
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  const double middle = n % 2 == 1 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
  return {middle, values.front(), values.back()};
}

double percentile(std::vector<double> values, double fraction) {
  if (values.empty()) return 0;
  const auto rank = static_cast<std::size_t>(std::ceil(fraction * static_cast<double>(values.size())));
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(std::clamp<std::size_t>(rank, 1, values.size()) - 1);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace earshot
