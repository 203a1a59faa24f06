// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <optional>

#include "sim/nav/navmesh.h"

namespace earshot {

/// Shortest walkable distance from anywhere to one goal.  Built once per goal, then queried every step by many agents.
/// Immutable and safe from any thread.
class GeodesicField {
 public:
  /// Throws InputError if the goal is more than `reach_m` from the walkable surface.  `navmesh` must outlive the field.
  GeodesicField(const Navmesh& navmesh, glm::vec3 goal, float reach_m = 1.0f);
  ~GeodesicField();
  GeodesicField(GeodesicField&&) noexcept;

  /// Metres along the surface, continuous in `point`; nullopt if no path leads to the goal.  A few microseconds.
  [[nodiscard]] std::optional<float> distance_m(glm::vec3 point) const;
  /// Next corner of the shortest path from `point` (the goal itself if in line of sight); nullopt if unreachable.
  [[nodiscard]] std::optional<glm::vec3> next_corner(glm::vec3 point) const;
  [[nodiscard]] glm::vec3 goal() const;  ///< on the surface

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
