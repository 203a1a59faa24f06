// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>

namespace earshot {

/// What the others see of an agent: an upright cylinder of one colour.
struct AgentBody {
  glm::vec3 foot{0};  ///< middle of its base
  float radius_m = 0.1f, height_m = 1.5f;
  glm::vec3 color{0.5f};  ///< linear light
  friend bool operator==(const AgentBody&, const AgentBody&) = default;
};

/// Nearest hit of one ray; infinite where it misses.
struct BodyHit {
  float distance_m = std::numeric_limits<float>::infinity();
  glm::vec3 normal{0};  ///< unit, toward the ray's origin
  [[nodiscard]] bool valid() const { return distance_m < std::numeric_limits<float>::infinity(); }
};
/// direction: unit.  From inside, the far side.  In double, as a body is thin beside its distance.
BodyHit intersect(const AgentBody& body, glm::vec3 origin, glm::vec3 direction);

/// Base colour of the body of an agent of a scene by its number, from 0: hues one golden angle apart, so that the first ones differ most.
glm::vec3 body_color(int agent);
/// What a body is in pictures of categories: the index of "agent" in category_names().
std::uint16_t agent_category();

}  // namespace earshot
