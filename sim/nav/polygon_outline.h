// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <glm/common.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <utility>

#include "sim/nav/surface.h"

namespace earshot {

/// A polygon of the surface as seen from above.
struct PolygonOutline {
  std::array<glm::dvec3, Surface::kMaxCorners> corners{};
  int count = 0;

  PolygonOutline(const Surface& surface, int polygon) : count(surface.polygons()[static_cast<std::size_t>(polygon)].num_corners) {
    for (int i = 0; i < count; ++i) corners[static_cast<std::size_t>(i)] = surface.vertex(polygon, i);
  }
  [[nodiscard]] std::span<const glm::dvec3> points() const { return std::span(corners).first(static_cast<std::size_t>(count)); }

  /// Least and largest coordinates of its corners.
  [[nodiscard]] std::pair<glm::dvec3, glm::dvec3> bounds() const {
    glm::dvec3 least = corners[0], most = corners[0];
    for (const glm::dvec3& corner : points()) {
      least = glm::min(least, corner);
      most = glm::max(most, corner);
    }
    return {least, most};
  }

  /// Convex: inside where a point is on the same side of every edge.
  [[nodiscard]] bool contains(double x, double z) const {
    bool left = false, right = false;
    for (std::size_t i = 0; i < points().size(); ++i) {
      const glm::dvec3 a = corners[i], b = corners[(i + 1) % points().size()];
      const double side = (b.x - a.x) * (z - a.z) - (b.z - a.z) * (x - a.x);
      left = left || side > 0;
      right = right || side < 0;
    }
    return !(left && right);
  }

  /// Of the triangle of its fan that holds the point; of the mean where rounding leaves none.
  [[nodiscard]] double height_at(double x, double z) const {
    const glm::dvec3 a = corners[0];
    double sum = 0;
    for (const glm::dvec3& corner : points()) sum += corner.y;
    for (std::size_t i = 1; i + 1 < points().size(); ++i) {
      const glm::dvec3 b = corners[i] - a, c = corners[i + 1] - a;
      const double area = b.x * c.z - b.z * c.x;
      if (area == 0) continue;
      const double v = ((x - a.x) * c.z - (z - a.z) * c.x) / area, w = (b.x * (z - a.z) - b.z * (x - a.x)) / area;
      if (v >= -1e-9 && w >= -1e-9 && v + w <= 1 + 1e-9) return a.y + v * b.y + w * c.y;
    }
    return sum / count;
  }
};

}  // namespace earshot
