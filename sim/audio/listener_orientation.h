#pragma once

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

namespace earshot {

/// How a listener (or a source) is turned: from world axes (x right, y up, -z front) to its own.
class ListenerTurn {
 public:
  /// heading_rad: counter-clockwise from above.  Exactly what to_head_axes does.
  ListenerTurn(double heading_rad = 0) : level_(true), heading_rad_(heading_rad) {}
  /// pitch_rad: the nose up.  roll_rad: the right ear down.  Rolled first, then pitched, then turned to the heading.
  ListenerTurn(double heading_rad, double pitch_rad, double roll_rad);
  /// own_to_world: any length but zero (InputError).
  explicit ListenerTurn(const glm::dquat& own_to_world);

  /// Is only the heading turned?
  [[nodiscard]] bool level() const { return level_; }
  /// Of a level listener.
  [[nodiscard]] double heading_rad() const { return heading_rad_; }
  [[nodiscard]] glm::dquat own_to_world() const;
  [[nodiscard]] glm::vec3 to_own(glm::vec3 world) const;
  [[nodiscard]] glm::vec3 to_world(glm::vec3 own) const;

 private:
  bool level_;
  double heading_rad_ = 0;
  glm::dquat own_to_world_{1, 0, 0, 0};  ///< of a listener that is not level
};

}  // namespace earshot
