#pragma once

#include <cmath>

namespace earshot {

/// Where space ends, in metres along each axis: no scene is as large, squares and volumes of such coordinates still fit a float, and
/// the ray library ends the process on a ray from 1e30 m.
inline constexpr double kFarthestM = 1e9;

/// Is it within that?  Not so for NaN.
template <typename Vec3>
[[nodiscard]] bool is_place(const Vec3& p) {
  return std::fabs(p.x) <= kFarthestM && std::fabs(p.y) <= kFarthestM && std::fabs(p.z) <= kFarthestM;
}

}  // namespace earshot
