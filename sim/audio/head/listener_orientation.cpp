// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/listener_orientation.h"

#include <cmath>

#include "sim/audio/head/ambisonics.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

glm::dquat about(glm::dvec3 axis, double angle_rad) {
  return {std::cos(0.5 * angle_rad), std::sin(0.5 * angle_rad) * axis.x, std::sin(0.5 * angle_rad) * axis.y,
          std::sin(0.5 * angle_rad) * axis.z};
}

}  // namespace

ListenerOrientation::ListenerOrientation(double heading_rad, double pitch_rad, double roll_rad)
    : level_(pitch_rad == 0 && roll_rad == 0),
      heading_rad_(heading_rad),
      local_to_world_(about({0, 1, 0}, heading_rad) * about({1, 0, 0}, pitch_rad) * about({0, 0, -1}, roll_rad)) {}

ListenerOrientation::ListenerOrientation(const glm::dquat& local_to_world) : level_(false) {
  const double length = glm::length(local_to_world);
  require(std::isfinite(length) && length > 1e-12, "orientation length", length, "must be positive: a quaternion (w, x, y, z)");
  local_to_world_ = local_to_world / length;
}

glm::dquat ListenerOrientation::local_to_world() const { return level_ ? about({0, 1, 0}, heading_rad_) : local_to_world_; }

glm::vec3 ListenerOrientation::world_to_local(glm::vec3 world) const {
  return level_ ? to_head_axes(world, heading_rad_) : glm::vec3(glm::conjugate(local_to_world_) * glm::dvec3(world));
}

glm::vec3 ListenerOrientation::local_to_world(glm::vec3 local) const {
  return level_ ? to_head_axes(local, -heading_rad_) : glm::vec3(local_to_world_ * glm::dvec3(local));
}

}  // namespace earshot
