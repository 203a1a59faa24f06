// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/listener_frame.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <numbers>

namespace earshot {

glm::dvec3 sofa_position(glm::dvec3 value, bool is_spherical) {
  if (!is_spherical) return value;
  constexpr double degree = std::numbers::pi / 180;
  const double azimuth = value.x * degree, elevation = value.y * degree;
  return value.z * glm::dvec3(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
}

ListenerFrame::ListenerFrame(glm::dvec3 position_m, glm::dvec3 view, glm::dvec3 up) : position_m_(position_m) {
  constexpr double kParallel = 1e-6;
  const glm::dvec3 front = glm::normalize(view);
  const auto across = [&](glm::dvec3 axis) { return axis - glm::dot(axis, front) * front; };
  glm::dvec3 above = across(up);
  if (!(glm::length(above) > kParallel * glm::length(up))) above = across({0, 0, 1});
  if (!(glm::length(above) > kParallel)) above = across({-front.z, 0, 0});  // looks straight up or down: its crown is behind or before it
  above = glm::normalize(above);
  to_head_ = glm::transpose(glm::dmat3(glm::cross(front, above), above, -front));
}

}  // namespace earshot
