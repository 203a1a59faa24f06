// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

namespace earshot {

/// Sum of squares.
inline double energy_of(std::span<const float> samples) {
  double sum = 0;
  for (const float value : samples) sum += double{value} * double{value};
  return sum;
}

}  // namespace earshot
