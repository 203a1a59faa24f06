// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/corner_graph.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <optional>

namespace earshot {
namespace {

// Off the vertex by this much: far above the rounding of float positions, and a path around a corner grows by a millimetre at most.
constexpr double kStandoffM = 0.001, kSmallestStandoffM = 0.00005;
constexpr double kStraightRad = 1e-4;  // walls that bend less than this make no corner

glm::dvec3 horizontal_unit(glm::dvec3 v) {
  v.y = 0;
  return v / std::sqrt(v.x * v.x + v.z * v.z);
}

// Turn from a to b, counter-clockwise in (x, z), [0, 2 pi).
double turn_rad(glm::dvec3 a, glm::dvec3 b) {
  const double angle = std::atan2(a.x * b.z - a.z * b.x, a.x * b.x + a.z * b.z);
  return angle < 0 ? angle + 2 * std::numbers::pi : angle;
}

glm::dvec3 turned(glm::dvec3 v, double angle_rad) {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  return {c * v.x - s * v.z, 0, s * v.x + c * v.z};
}

int edge_to(const Surface::Polygon& polygon, int neighbour, int first_corner) {
  for (int i = 0; i < polygon.num_corners; ++i)
    if (polygon.neighbours[i] == neighbour && polygon.corners[i] == first_corner) return i;
  return -1;
}

// The corner at the start of a wall edge, if the surface turns by more than half a turn there.
std::optional<Corner> corner_at(const Surface& surface, int polygon, int edge) {
  const Surface::Polygon* start_polygon = &surface.polygons()[polygon];
  const int vertex = start_polygon->corners[edge];
  const glm::dvec3 position = surface.vertices()[vertex];
  const auto towards = [&](int other) { return horizontal_unit(surface.vertices()[other] - position); };
  const glm::dvec3 wall_out = towards(start_polygon->corners[(edge + 1) % start_polygon->num_corners]);

  // Around the vertex through all polygons up to the other wall.
  struct Sector {
    int polygon;
    double from_rad, to_rad;
  };
  std::vector<Sector> sectors;
  double opening_rad = 0;
  glm::dvec3 wall_in{};
  for (std::size_t guard = 0; guard <= surface.polygons().size(); ++guard) {
    const int before = (edge + start_polygon->num_corners - 1) % start_polygon->num_corners;
    const glm::dvec3 next = towards(start_polygon->corners[(edge + 1) % start_polygon->num_corners]),
                     previous = towards(start_polygon->corners[before]);
    const double sector_rad = turn_rad(next, previous);
    sectors.push_back({polygon, opening_rad, opening_rad + sector_rad});
    opening_rad += sector_rad;
    wall_in = previous;
    const int beyond = start_polygon->neighbours[before];
    if (beyond == Surface::kWall) break;
    edge = edge_to(surface.polygons()[beyond], polygon, vertex);
    if (edge < 0) return std::nullopt;
    polygon = beyond;
    start_polygon = &surface.polygons()[polygon];
  }
  if (opening_rad <= std::numbers::pi + kStraightRad) return std::nullopt;

  const double middle_rad = 0.5 * opening_rad;
  const auto sector = std::find_if(sectors.begin(), sectors.end(), [&](const Sector& s) { return middle_rad <= s.to_rad; });
  if (sector == sectors.end()) return std::nullopt;
  const glm::dvec3 outward = turned(wall_out, middle_rad);
  for (double standoff = kStandoffM; standoff >= kSmallestStandoffM; standoff *= 0.5) {
    const glm::dvec3 target = position + standoff * outward;
    const Surface::Walk straight_walk = surface.walk(sector->polygon, position, target);
    if (straight_walk.arrived && surface.walk(sector->polygon, position, position + 2.0 * standoff * outward).arrived)
      return Corner{target, wall_in, wall_out, straight_walk.polygon, surface.polygons()[straight_walk.polygon].island};
  }
  return std::nullopt;
}

}  // namespace

bool is_tangent(const Corner& corner, glm::dvec3 direction, double slack) {
  const double side_in = direction.x * corner.wall_in.z - direction.z * corner.wall_in.x;
  const double side_out = direction.x * corner.wall_out.z - direction.z * corner.wall_out.x;
  return !(side_in > slack && side_out < -slack) && !(side_in < -slack && side_out > slack);
}

double tangent_slack(double distance_m) { return 1e-3 + 3.0 * kStandoffM / std::max(distance_m, kStandoffM); }

CornerGraph::CornerGraph(const Surface& surface) {
  for (int p = 0; p < static_cast<int>(surface.polygons().size()); ++p)
    for (int i = 0; i < surface.polygons()[p].num_corners; ++i)
      if (surface.polygons()[p].neighbours[i] == Surface::kWall)
        if (const auto corner = corner_at(surface, p, i)) corners_.push_back(*corner);

  const auto count = static_cast<std::uint32_t>(corners_.size());
  std::vector<std::vector<Edge>> edges(count);
  for (std::uint32_t a = 0; a < count; ++a)
    for (std::uint32_t b = a + 1; b < count; ++b) {
      const Corner &from = corners_[a], &to = corners_[b];
      if (from.island != to.island) continue;
      const double dx = to.position.x - from.position.x, dz = to.position.z - from.position.z;
      const double distance_m = std::sqrt(dx * dx + dz * dz);
      const glm::dvec3 direction = distance_m > 0 ? glm::dvec3{dx / distance_m, 0, dz / distance_m} : glm::dvec3{1, 0, 0};
      const double slack = tangent_slack(distance_m);
      if (!is_tangent(from, direction, slack) || !is_tangent(to, direction, slack)) continue;
      const Surface::Walk walk = surface.walk(from.polygon, from.position, to.position);
      if (!walk.arrived) continue;
      edges[a].push_back({b, walk.length_m});
      edges[b].push_back({a, walk.length_m});
    }
  first_edge_.assign(1, 0);
  for (const auto& list : edges) {
    edges_.insert(edges_.end(), list.begin(), list.end());
    first_edge_.push_back(edges_.size());
  }
}

}  // namespace earshot
