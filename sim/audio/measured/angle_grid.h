// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <glm/vec3.hpp>
#include <numbers>

namespace earshot {

/// Directions every 5 degrees of elevation and azimuth.  Rows rise from straight down to straight up; columns go round counter-clockwise
/// from the front, seen from above.  All nodes of a pole's row are the pole.  Bilinear between nodes, continuous everywhere.
class AngleGrid {
 public:
  static constexpr std::size_t kStepsPerQuarter = 18, kRows = 2 * kStepsPerQuarter + 1, kColumns = 4 * kStepsPerQuarter;
  static constexpr std::size_t kNodes = kRows * kColumns, kFront = kStepsPerQuarter * kColumns;

  /// Unit: x right, y up, -z front.  node: row * kColumns + column.
  static glm::vec3 direction(std::size_t node) {
    constexpr double step_rad = 0.5 * std::numbers::pi / kStepsPerQuarter;
    const std::size_t row = node / kColumns;
    const double elevation = (static_cast<double>(row) - kStepsPerQuarter) * step_rad;
    const double level = row == 0 || row + 1 == kRows ? 0.0 : std::cos(elevation);
    const double azimuth = static_cast<double>(node % kColumns) * step_rad;
    return glm::vec3(-level * std::sin(azimuth), std::sin(elevation), -level * std::cos(azimuth));
  }

  /// The four nodes around a direction: below, below to the left, above, above to the left.
  template <class Real>
  struct Place {
    std::array<std::size_t, 4> node;
    Real up, left;
    [[nodiscard]] Real between(Real a, Real b, Real c, Real d) const {
      const Real low = a + left * (b - a), high = c + left * (d - c);
      return low + up * (high - low);
    }
  };
  /// towards: unit.
  template <class Real>
  static Place<Real> find(glm::vec3 towards) {
    constexpr Real steps_per_rad = Real(kStepsPerQuarter) / (Real(0.5) * std::numbers::pi_v<Real>);
    const Real x = towards.x, y = towards.y, z = towards.z;
    // atan2 for the elevation too: near a pole the arc sine of a float is good to 0.02 degrees only.
    const Real height = std::atan2(y, std::hypot(x, z)) * steps_per_rad + Real(kStepsPerQuarter);
    const Real around = std::atan2(-x, -z) * steps_per_rad + Real(kColumns);  // at least half a turn, never negative
    const std::size_t row = std::min(static_cast<std::size_t>(std::max(height, Real(0))), kRows - 2);
    const auto column = static_cast<std::size_t>(around);
    const std::size_t right = column % kColumns, left = (column + 1) % kColumns;
    return {{row * kColumns + right, row * kColumns + left, (row + 1) * kColumns + right, (row + 1) * kColumns + left},
            std::min(height - static_cast<Real>(row), Real(1)),
            around - static_cast<Real>(column)};
  }
};

}  // namespace earshot
