// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

namespace earshot {

/// Where space ends, in metres along each axis: no scene is as large, squares and volumes of such coordinates still fit a float, and
/// the ray library ends the process on a ray from 1e30 m.
inline constexpr double kMaxCoordinateM = 1e9;

/// Is it within that?  Not so for NaN.
template <typename Vec3>
[[nodiscard]] bool is_valid_position(const Vec3& p) {
  return std::fabs(p.x) <= kMaxCoordinateM && std::fabs(p.y) <= kMaxCoordinateM && std::fabs(p.z) <= kMaxCoordinateM;
}

}  // namespace earshot
