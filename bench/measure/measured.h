// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace earshot {

/// A repeated measurement.
struct Measured {
  double value = 0, min = 0, max = 0;  ///< value: the median
};
/// Median (of an even count: mean of the two in the middle), smallest and largest.  values: not empty.
Measured median_of(std::vector<double> values);

/// The smallest of the values that at least a fraction of them, in (0, 1], does not exceed; 0 without values.
double percentile(std::vector<double> values, double fraction);

}  // namespace earshot
