// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/base/memory_bytes.h"

namespace earshot {

/// The polygons of a navigation mesh in double, for straight walks over them.  Convex, joined edge to edge.
class Surface {
 public:
  static constexpr int kMaxCorners = 6;
  static constexpr int kWall = -1;

  /// Corners counter-clockwise in (x, z); neighbours[i] is across the edge from corner i to the next, kWall where the surface ends.
  struct Polygon {
    int num_corners = 0;
    int corners[kMaxCorners] = {};
    int neighbours[kMaxCorners] = {};
    int island = 0;
  };

  Surface() = default;
  Surface(std::vector<glm::dvec3> vertices, std::vector<Polygon> polygons);

  [[nodiscard]] std::span<const glm::dvec3> vertices() const { return vertices_; }
  [[nodiscard]] std::span<const Polygon> polygons() const { return polygons_; }
  [[nodiscard]] int num_islands() const { return num_islands_; }
  [[nodiscard]] std::size_t bytes() const { return bytes_of(vertices_) + bytes_of(polygons_); }  ///< of memory
  [[nodiscard]] double area_m2(int polygon) const;                                               ///< seen from above
  [[nodiscard]] glm::dvec3 vertex(int polygon, int corner) const { return vertices_[polygons_[polygon].corners[corner]]; }

  /// How a straight walk ended.
  struct Walk {
    bool arrived = false;
    int polygon = 0;        ///< where it ended: at its target, or at the wall
    int wall_edge = kWall;  ///< of that polygon, if it was stopped
    double fraction = 1;    ///< of the way that was covered; below 0 or 1e-9 if the start was on the wall
    double length_m = 0;    ///< along the surface, up to the target or the wall; polygons count as flat between their edges
  };
  /// The straight walk (seen from above) from a point of `polygon`.  Safe on edges and corners: a walk leaves a polygon by the first
  /// edge that it crosses outward, independent of rounding at its entry.  About 20 ns per polygon crossed, no allocation.
  [[nodiscard]] Walk walk(int polygon, glm::dvec3 from, glm::dvec3 to) const;

  /// `point` of `polygon` moved to at least `clearance_m` from this polygon's walls (less where the polygon is too narrow), so that a
  /// walk that starts on a wall does not stop there.
  [[nodiscard]] glm::dvec3 off_walls(int polygon, glm::dvec3 point, double clearance_m) const;
  [[nodiscard]] double clearance_of_wall_m(int polygon, int edge, glm::dvec3 point) const;  ///< negative outside

 private:
  void find_islands();
  /// Of the plane through three corners of the polygon, above or below `point`.
  [[nodiscard]] double height_m(const Polygon& polygon, glm::dvec3 point) const;

  std::vector<glm::dvec3> vertices_;
  std::vector<Polygon> polygons_;
  int num_islands_ = 0;
};

}  // namespace earshot
