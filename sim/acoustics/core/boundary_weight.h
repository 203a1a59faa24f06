// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

namespace earshot {

/// Weight of what an edge does to a path that is shorter by `waves` wavelengths: 1 to a quarter, 0 from a half on, half a cosine between.
inline double boundary_weight(double waves) {
  const double x = 4.0 * waves - 1.0;
  return x <= 0 ? 1.0 : x >= 1 ? 0.0 : 0.5 + 0.5 * std::cos(std::numbers::pi * x);
}

}  // namespace earshot
