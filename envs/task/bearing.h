// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <glm/vec3.hpp>
#include <numbers>

namespace earshot {

/// Radians in [-pi, pi] from the heading to the horizontal part of `toward`, positive to the left: the heading h looks along
/// (-sin h, 0, -cos h), as forward_of.
inline double bearing_rad(glm::dvec3 toward, double heading_rad) {
  return std::remainder(std::atan2(-toward.x, -toward.z) - heading_rad, 2.0 * std::numbers::pi);
}

}  // namespace earshot
