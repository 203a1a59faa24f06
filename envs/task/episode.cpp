// SPDX-License-Identifier: Apache-2.0
#include "envs/task/episode.h"

#include <cmath>
#include <glm/gtc/quaternion.hpp>

#include "sim/base/errors.h"

namespace earshot {

double heading_of(const std::array<float, 4>& rotation) {
  const double x = rotation[0], y = rotation[1], z = rotation[2], w = rotation[3];
  const double norm = std::sqrt(x * x + y * y + z * z + w * w);
  if (!std::isfinite(norm) || norm < 1e-6)
    throw InputError("start_rotation", "is not a rotation: its quaternion is zero or not finite", "write x, y, z, w of a unit quaternion");
  const glm::dvec3 forward = glm::dquat(w / norm, x / norm, y / norm, z / norm) * glm::dvec3(0, 0, -1);
  // forward_of(h) = (-sin h, 0, -cos h); an agent that looks straight up or down has no heading and gets 0.
  if (forward.x * forward.x + forward.z * forward.z < 1e-18) return 0.0;
  return std::atan2(-forward.x, -forward.z);
}

std::array<float, 4> rotation_of(double heading_rad) {
  return {0.f, static_cast<float>(std::sin(heading_rad / 2)), 0.f, static_cast<float>(std::cos(heading_rad / 2))};
}

}  // namespace earshot
