// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>

namespace earshot {

/// Point on the unit sphere from two numbers in [0, 1): equal areas of the square become equal areas of the sphere (Archimedes).
inline glm::vec3 sphere_direction(float u, float v) {
  const float z = 1.f - 2.f * u;
  const float radius = 2.f * std::sqrt(u * (1.f - u));  // sqrt(1 - z^2) without its cancellation
  const float angle = 2.f * std::numbers::pi_v<float> * v;
  return {radius * std::cos(angle), z, radius * std::sin(angle)};
}

/// Cosine-weighted direction about a unit normal: the tip of the normal is the centre of a unit sphere, and the line from its foot to a
/// uniform point of that sphere is Lambert distributed (tangent-sphere construction; no tangent frame needed).
inline glm::vec3 lambert_direction(glm::vec3 normal, float u, float v) {
  const glm::vec3 sum = normal + sphere_direction(u, v);
  const float length2 = glm::dot(sum, sum);
  // The point opposite to the normal gives a zero vector, with probability below 1e-7.
  return length2 > 1e-12f ? sum / std::sqrt(length2) : normal;
}

inline glm::vec3 mirror_direction(glm::vec3 direction, glm::vec3 normal) {
  const glm::vec3 mirrored = direction - 2.f * glm::dot(direction, normal) * normal;
  return mirrored / std::sqrt(glm::dot(mirrored, mirrored));  // hundreds of mirrors in a row must not change the length
}

/// Directions of low discrepancy over the sphere: the additive R2 sequence (Roberts 2018) with a random shift (Cranley and Patterson
/// 1976), so that each direction alone is uniform and the estimate stays unbiased.  shift: two random words.
class SphereSequence {
 public:
  SphereSequence(std::uint32_t shift_u, std::uint32_t shift_v) : shift_u_(shift_u), shift_v_(shift_v) {}
  [[nodiscard]] glm::vec3 direction(std::uint32_t index) const {
    // Steps are the fractions 0.7548776662466927 and 0.5698402909980532 in units of 2^-32: integer wrap-around is exact.
    const std::uint32_t u = shift_u_ + index * 3242174889u, v = shift_v_ + index * 2447445414u;
    return sphere_direction(static_cast<float>(u >> 8) * 0x1p-24f, static_cast<float>(v >> 8) * 0x1p-24f);
  }

 private:
  std::uint32_t shift_u_, shift_v_;
};

}  // namespace earshot
