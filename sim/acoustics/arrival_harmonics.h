#pragma once

#include <glm/vec3.hpp>
#include <numbers>
#include <span>

#include "sim/audio/ambisonics.h"

namespace earshot {

/// Real N3D harmonics of an arrival direction (unit, world axes): [(order + 1)^2].  Spelt out up to order 1.
inline void write_harmonics(glm::vec3 direction, int order, std::span<float> sh) {
  if (order > 1) return spherical_harmonics_n3d(direction, order, sh);
  sh[0] = 1.f;
  if (order == 0) return;
  // Ambisonic axes (x, y, z) = (-z, -x, y) of the world; ACN order W, Y, Z, X.
  const float root3 = std::numbers::sqrt3_v<float>;
  sh[1] = -root3 * direction.x;
  sh[2] = root3 * direction.y;
  sh[3] = -root3 * direction.z;
}

}  // namespace earshot
