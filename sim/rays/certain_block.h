// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

namespace earshot {

/// True if the segment passes through the triangle with a margin, so that every ray tracer agrees.  False where rounding could decide:
/// where the segment passes within 1e-5 of the largest coordinate of a side, ends that close to the plane of the triangle, or meets
/// it at less than half a degree.
inline bool certainly_blocks(glm::vec3 a, glm::vec3 b, glm::vec3 c, glm::vec3 from, glm::vec3 to) {
  using Vector = glm::dvec3;
  const Vector origin(a), ab = Vector(b) - origin, ac = Vector(c) - origin, normal = glm::cross(ab, ac);
  const Vector start = Vector(from) - origin, along = Vector(to) - Vector(from);
  const double start_height = glm::dot(normal, start), slope = glm::dot(normal, along),
               end_height = start_height + slope;  // times the length of the normal
  if (!(start_height * end_height < 0)) return false;
  const glm::vec3 size = glm::max(glm::max(glm::abs(from), glm::abs(to)), glm::max(glm::abs(a), glm::max(glm::abs(b), glm::abs(c))));
  const double margin_m = 1e-5 * std::max({size.x, size.y, size.z}), normal2 = glm::dot(normal, normal);
  const double least2 = margin_m * margin_m * normal2;
  constexpr double least_sine2 = 7.6e-5;
  if (!(start_height * start_height > least2 && end_height * end_height > least2 &&
        slope * slope > least_sine2 * normal2 * glm::dot(along, along)))
    return false;
  const Vector at = start - (start_height / slope) * along;
  // Twice the area between the point and a side, times the length of the normal: their distance times both lengths.  Seen along the
  // segment that distance is shorter by the sine of its angle with the plane.
  const double least_area2 = least2 * normal2 * glm::dot(along, along) / (slope * slope);
  const auto inside = [&](Vector corner, Vector side) {
    const double area = glm::dot(normal, glm::cross(side, at - corner));
    return area > 0 && area * area > least_area2 * glm::dot(side, side);
  };
  return inside(Vector(0), ab) && inside(ab, ac - ab) && inside(ac, -ac);
}

}  // namespace earshot
