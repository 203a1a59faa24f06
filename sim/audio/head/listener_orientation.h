// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

namespace earshot {

/// Orientation of a listener or a source: a rotation between world axes (x right, y up, -z front) and its local ones.
class ListenerOrientation {
 public:
  /// heading_rad: counter-clockwise from above.  Exactly what to_head_axes does.
  ListenerOrientation(double heading_rad = 0) : level_(true), heading_rad_(heading_rad) {}
  /// pitch_rad: the nose up.  roll_rad: the right ear down.  Roll comes first, then pitch, then heading.
  ListenerOrientation(double heading_rad, double pitch_rad, double roll_rad);
  /// local_to_world: any length but zero (InputError).
  explicit ListenerOrientation(const glm::dquat& local_to_world);

  /// Does only the heading differ from zero?
  [[nodiscard]] bool level() const { return level_; }
  /// Of a level listener.
  [[nodiscard]] double heading_rad() const { return heading_rad_; }
  [[nodiscard]] glm::dquat local_to_world() const;
  [[nodiscard]] glm::vec3 world_to_local(glm::vec3 world) const;
  [[nodiscard]] glm::vec3 local_to_world(glm::vec3 local) const;

 private:
  bool level_;
  double heading_rad_ = 0;
  glm::dquat local_to_world_{1, 0, 0, 0};  ///< of a listener that is not level
};

}  // namespace earshot
