// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <numbers>
#include <vector>

#include "sim/audio/head/ambisonics.h"
#include "sim/base/random.h"

namespace earshot {

inline constexpr double kDegree = std::numbers::pi / 180.0;

/// One of endlessly many, evenly distributed over the sphere.
inline glm::vec3 random_direction(std::uint32_t stream, std::uint32_t index) {
  const auto u = RandomStream(stream, Purpose::test).uniform2(index);
  const double height = 2.0 * static_cast<double>(u[0]) - 1.0, angle = 2.0 * std::numbers::pi * static_cast<double>(u[1]);
  const double radius = std::sqrt(1.0 - height * height);
  return {static_cast<float>(radius * std::cos(angle)), static_cast<float>(height), static_cast<float>(radius * std::sin(angle))};
}

inline std::vector<float> harmonics(glm::vec3 direction, int order) {
  std::vector<float> values(static_cast<std::size_t>((order + 1) * (order + 1)));
  spherical_harmonics_n3d(direction, order, values);
  return values;
}

}  // namespace earshot
