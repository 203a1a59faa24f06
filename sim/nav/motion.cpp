// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/motion.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "sim/nav/navmesh_impl.h"

namespace earshot {
namespace {

constexpr float kSamePlaceM = 1e-4f;  // nearer than this it is on the surface, and its bits are kept
constexpr double kClearanceM = 1e-4;  // agents stop this far from a wall: far above the rounding of their float position
constexpr double kStuckM = 3e-4;      // progress of a blocked move below this is rounding: the agent stands still, bit for bit
constexpr double kCollisionM = 1e-3;
constexpr int kMaxWalls = 4;  // met in one move

double flat_length(glm::dvec3 v) { return std::sqrt(v.x * v.x + v.z * v.z); }

struct Place {
  int polygon;
  glm::dvec3 point;
};

// Straight on; at a wall, on along it with what is left of the move in its direction.  Every segment is a walk over the surface, so no
// wall, however thin, is crossed and no corner cut.
Place slide_along_walls(const Surface& surface, Place at, glm::dvec3 displacement, bool& blocked) {
  for (int walls = 0; walls <= kMaxWalls; ++walls) {
    const Surface::Walk walk = surface.walk(at.polygon, at.point, at.point + displacement);
    if (walk.arrived) return {walk.polygon, at.point + displacement};
    blocked = true;
    if (walk.wall_edge == Surface::kWall) return at;
    const glm::dvec3 stop = surface.off_walls(walk.polygon, at.point + std::max(0.0, walk.fraction) * displacement, kClearanceM);
    const Surface::Walk to_stop = surface.walk(at.polygon, at.point, stop);
    if (!to_stop.arrived) return at;
    at = {to_stop.polygon, stop};
    const int next = (walk.wall_edge + 1) % surface.polygons()[walk.polygon].num_corners;
    const glm::dvec3 wall = surface.vertex(walk.polygon, next) - surface.vertex(walk.polygon, walk.wall_edge);
    const glm::dvec3 along = glm::normalize(glm::dvec3(wall.x, 0, wall.z));
    displacement = (1.0 - std::max(0.0, walk.fraction)) * glm::dot(displacement, along) * along;
  }
  return at;
}

}  // namespace

MoveResult slide(const Navmesh& navmesh, glm::vec3 from, glm::vec3 displacement) {
  const Navmesh::Impl& nav = navmesh.impl();
  const glm::dvec3 horizontal(displacement.x, 0, displacement.z);
  const double wanted_m = flat_length(horizontal);
  const auto start = nav.locate(from, kReachM);
  if (!start || !std::isfinite(wanted_m)) return {from, true};
  const bool on_surface = std::hypot(start->point.x - from.x, start->point.z - from.z) < kSamePlaceM;
  if (!on_surface) from = start->point;

  bool blocked = false;
  const glm::dvec3 origin(from);
  const Place clear{start->polygon, nav.surface.off_walls(start->polygon, origin, 0.5 * kClearanceM)};
  const Place end = slide_along_walls(nav.surface, clear, horizontal, blocked);
  const double covered_m = flat_length(end.point - origin);
  if (wanted_m == 0 || (blocked && covered_m < kStuckM)) return {from, wanted_m > kCollisionM};
  glm::vec3 reached(end.point);
  reached.y = nav.height_at(end.polygon, reached);
  return {reached, covered_m < wanted_m - kCollisionM};
}

}  // namespace earshot
