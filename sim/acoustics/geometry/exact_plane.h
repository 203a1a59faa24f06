// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "sim/acoustics/geometry/mirror_planes.h"

namespace earshot {

/// A mirror plane in double and exactly unit, so that mirroring forth and back keeps all digits of a float.
struct ExactPlane {
  explicit ExactPlane(const MirrorPlane& plane) : normal(plane.normal), offset_m(plane.offset_m) {
    const double length = glm::length(normal);
    normal /= length;
    offset_m /= length;
  }
  [[nodiscard]] double height(glm::dvec3 point) const { return glm::dot(normal, point) - offset_m; }
  [[nodiscard]] glm::dvec3 mirror(glm::dvec3 point) const { return point - 2.0 * height(point) * normal; }
  [[nodiscard]] glm::dvec3 mirror_vector(glm::dvec3 v) const { return v - 2.0 * glm::dot(normal, v) * normal; }
  glm::dvec3 normal;
  double offset_m;
};

}  // namespace earshot
