// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/convex_polygon.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "sim/acoustics/geometry/exact_plane.h"

namespace earshot {

ConvexPolygon clipped(const ConvexPolygon& polygon, glm::dvec3 normal, double offset_m) {
  ConvexPolygon kept;
  kept.reserve(polygon.size() + 1);
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const glm::dvec3 current = polygon[i], next = polygon[(i + 1) % polygon.size()];
    const double height = glm::dot(normal, current) - offset_m, next_height = glm::dot(normal, next) - offset_m;
    if (height >= 0) kept.push_back(current);
    if ((height >= 0) != (next_height >= 0)) kept.push_back(current + height / (height - next_height) * (next - current));
  }
  if (kept.size() < 3) kept.clear();
  return kept;
}

ConvexPolygon polygon_of(const MirrorPlane& plane) {
  const ExactPlane exact(plane);
  const glm::dvec3 lower(plane.bounds.lower), upper(plane.bounds.upper), middle = 0.5 * (lower + upper);
  const glm::dvec3 centre = middle - exact.height(middle) * exact.normal, normal = exact.normal;
  const glm::dvec3 along = std::abs(normal.x) < 0.6 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const double reach_m = glm::length(upper - lower);
  const glm::dvec3 u = reach_m * glm::normalize(glm::cross(normal, along)), v = glm::cross(normal, u);
  ConvexPolygon polygon = {centre - u - v, centre + u - v, centre + u + v, centre - u + v};
  for (int axis = 0; axis < 3; ++axis) {
    glm::dvec3 outward(0);
    outward[axis] = 1;
    polygon = clipped(polygon, outward, lower[axis]);
    polygon = clipped(polygon, -outward, -upper[axis]);
  }
  return polygon;
}

ConvexPolygon lit_part(const ConvexPolygon& polygon, glm::dvec3 apex, const ConvexPolygon& aperture) {
  glm::dvec3 middle(0);
  for (const glm::dvec3 vertex : aperture) middle += vertex / static_cast<double>(aperture.size());
  ConvexPolygon lit = polygon;
  for (std::size_t i = 0; i < aperture.size() && !lit.empty(); ++i) {
    const glm::dvec3 side = glm::cross(aperture[i] - apex, aperture[(i + 1) % aperture.size()] - apex);
    const double length = glm::length(side);
    if (!(length > 0)) continue;  // two vertices in line with the apex
    const glm::dvec3 inward = (glm::dot(side, middle - apex) < 0 ? -1.0 : 1.0) / length * side;
    lit = clipped(lit, inward, glm::dot(inward, apex));
  }
  return lit;
}

}  // namespace earshot
