// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>

#include "sim/base/random.h"

/// Random rays with which a scene's report explores it.
namespace earshot::probe {

/// What the numbers of one random stream are for (its third word).
enum class Use : std::uint32_t { place = 0, first_ray = 1, walk = 2, partner = 3, connection = 4 };

inline RandomStream stream(std::uint64_t seed, Use use, std::uint32_t item) {
  return RandomStream(seed, Purpose::ray_efficiency, item, static_cast<std::uint32_t>(use));
}

inline glm::vec3 uniform_direction(std::array<float, 2> u) {
  const float y = 1 - 2 * u[0], radius = std::sqrt(std::max(0.f, 1 - y * y)), angle = 2 * std::numbers::pi_v<float> * u[1];
  return {radius * std::cos(angle), y, radius * std::sin(angle)};
}

/// Lambert: a unit vector around the normal plus the normal itself.
inline glm::vec3 cosine_direction(glm::vec3 normal, std::array<float, 2> u) {
  const glm::vec3 sum = normal + uniform_direction(u);
  const float length = glm::length(sum);
  return length > 1e-6f ? sum / length : normal;
}

}  // namespace earshot::probe
