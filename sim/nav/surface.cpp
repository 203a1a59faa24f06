// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/surface.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

namespace earshot {
namespace {

// Twice the area of a polygon, positive when it is counter-clockwise in (x, z).
double doubled_area(std::span<const glm::dvec3> vertices, const Surface::Polygon& polygon) {
  double sum = 0;
  const glm::dvec3 base = vertices[polygon.corners[0]];
  for (int i = 1; i + 1 < polygon.num_corners; ++i) {
    const glm::dvec3 a = vertices[polygon.corners[i]] - base, b = vertices[polygon.corners[i + 1]] - base;
    sum += a.x * b.z - a.z * b.x;
  }
  return sum;
}

}  // namespace

Surface::Surface(std::vector<glm::dvec3> vertices, std::vector<Polygon> polygons)
    : vertices_(std::move(vertices)), polygons_(std::move(polygons)) {
  for (Polygon& polygon : polygons_) {
    if (doubled_area(vertices_, polygon) >= 0) continue;
    // Reversed corners: edge i now runs between what were the ends of edge n - 2 - i.
    const int n = polygon.num_corners;
    std::reverse(polygon.corners, polygon.corners + n);
    std::reverse(polygon.neighbours, polygon.neighbours + n);
    std::rotate(polygon.neighbours, polygon.neighbours + 1, polygon.neighbours + n);
  }
  find_islands();
}

void Surface::find_islands() {
  for (Polygon& polygon : polygons_) polygon.island = -1;
  std::vector<int> open;
  for (int seed = 0; seed < static_cast<int>(polygons_.size()); ++seed) {
    if (polygons_[seed].island >= 0) continue;
    polygons_[seed].island = num_islands_;
    open.assign(1, seed);
    while (!open.empty()) {
      const Polygon& polygon = polygons_[open.back()];
      open.pop_back();
      for (int i = 0; i < polygon.num_corners; ++i) {
        const int next = polygon.neighbours[i];
        if (next == kWall || polygons_[next].island >= 0) continue;
        polygons_[next].island = num_islands_;
        open.push_back(next);
      }
    }
    ++num_islands_;
  }
}

double Surface::area_m2(int polygon) const { return 0.5 * doubled_area(vertices_, polygons_[polygon]); }

double Surface::height_m(const Polygon& polygon, glm::dvec3 point) const {
  const glm::dvec3 &a = vertices_[polygon.corners[0]], &b = vertices_[polygon.corners[1]];
  const glm::dvec3& c = vertices_[polygon.corners[polygon.num_corners - 1]];
  const glm::dvec3 normal = glm::cross(b - a, c - a);
  if (!(std::abs(normal.y) > 1e-12)) return a.y;
  return a.y - (normal.x * (point.x - a.x) + normal.z * (point.z - a.z)) / normal.y;
}

Surface::Walk Surface::walk(int polygon, glm::dvec3 from, glm::dvec3 to) const {
  constexpr double tie_m = 1e-9;  // a walk through a vertex may leave by either edge: by the open one
  constexpr double storey_m = 1.0;
  const double dx = to.x - from.x, dz = to.z - from.z;
  const double tie = tie_m / std::max(std::sqrt(dx * dx + dz * dz), tie_m);
  Walk walk{.polygon = polygon};
  glm::dvec3 last = from;
  for (std::size_t steps = 0; steps <= polygons_.size(); ++steps) {
    const Polygon& current = polygons_[walk.polygon];
    double exit = std::numeric_limits<double>::infinity();
    int exit_edge = -1;
    for (int i = 0; i < current.num_corners; ++i) {
      const glm::dvec3& a = vertices_[current.corners[i]];
      const glm::dvec3& b = vertices_[current.corners[i + 1 == current.num_corners ? 0 : i + 1]];
      const double normal_x = b.z - a.z, normal_z = a.x - b.x;  // outward
      const double outward = dx * normal_x + dz * normal_z;
      if (outward <= 0) continue;
      const double t = ((a.x - from.x) * normal_x + (a.z - from.z) * normal_z) / outward;
      double latest = exit;
      if (exit_edge >= 0) {
        const bool is_open = current.neighbours[i] != kWall, best_is_open = current.neighbours[exit_edge] != kWall;
        latest += is_open == best_is_open ? 0 : is_open ? tie : -tie;
      }
      if (t < latest) {
        exit = t;
        exit_edge = i;
      }
    }
    if (exit >= 1) {
      walk.length_m += glm::distance(last, to);
      // Storeys lie above each other: the same (x, z) may be on another floor.
      walk.arrived = std::abs(vertices_[current.corners[0]].y - to.y) < storey_m || std::abs(last.y - to.y) < storey_m ||
                     std::abs(height_m(current, to) - to.y) < storey_m;
      return walk;
    }
    const glm::dvec3& a = vertices_[current.corners[exit_edge]];
    const glm::dvec3& b = vertices_[current.corners[exit_edge + 1 == current.num_corners ? 0 : exit_edge + 1]];
    glm::dvec3 crossing{from.x + exit * dx, 0, from.z + exit * dz};
    const double edge_x = b.x - a.x, edge_z = b.z - a.z;
    const double along = ((crossing.x - a.x) * edge_x + (crossing.z - a.z) * edge_z) / (edge_x * edge_x + edge_z * edge_z);
    crossing.y = a.y + std::clamp(along, 0.0, 1.0) * (b.y - a.y);
    if (exit > 0) {
      walk.length_m += glm::distance(last, crossing);
      last = crossing;
    }
    if (current.neighbours[exit_edge] == kWall) {
      walk.wall_edge = exit_edge;
      walk.fraction = exit;
      return walk;
    }
    walk.polygon = current.neighbours[exit_edge];
  }
  walk.fraction = 0;
  return walk;
}

double Surface::clearance_of_wall_m(int polygon, int edge, glm::dvec3 point) const {
  const glm::dvec3 a = vertex(polygon, edge), b = vertex(polygon, (edge + 1) % polygons_[polygon].num_corners);
  const double inward_x = a.z - b.z, inward_z = b.x - a.x;
  return ((point.x - a.x) * inward_x + (point.z - a.z) * inward_z) / std::sqrt(inward_x * inward_x + inward_z * inward_z);
}

glm::dvec3 Surface::off_walls(int polygon, glm::dvec3 point, double clearance_m) const {
  const Polygon& start_polygon = polygons_[polygon];
  glm::dvec3 pushed = point;
  // Twice: in a corner the second wall may push back toward the first.
  for (int round = 0; round < 2; ++round)
    for (int i = 0; i < start_polygon.num_corners; ++i) {
      if (start_polygon.neighbours[i] != kWall) continue;
      const double missing_m = clearance_m - clearance_of_wall_m(polygon, i, pushed);
      if (missing_m <= 0) continue;
      const glm::dvec3 a = vertex(polygon, i), b = vertex(polygon, (i + 1) % start_polygon.num_corners);
      pushed += missing_m * glm::normalize(glm::dvec3(a.z - b.z, 0, b.x - a.x));
    }
  bool clear = true;
  for (int i = 0; i < start_polygon.num_corners; ++i)
    clear = clear && (start_polygon.neighbours[i] != kWall || clearance_of_wall_m(polygon, i, pushed) > 0.5 * clearance_m);
  if (clear) return pushed;

  // A wedge: toward the middle, as far as the nearest wall requires.
  glm::dvec3 middle{};
  for (int i = 0; i < start_polygon.num_corners; ++i) middle += vertex(polygon, i) / static_cast<double>(start_polygon.num_corners);
  double fraction = 0;
  for (int i = 0; i < start_polygon.num_corners; ++i) {
    if (start_polygon.neighbours[i] != kWall) continue;
    const double there_m = clearance_of_wall_m(polygon, i, middle), here_m = clearance_of_wall_m(polygon, i, point);
    const double wanted_m = std::min(clearance_m, 0.5 * there_m);
    if (here_m < wanted_m) fraction = std::max(fraction, (wanted_m - here_m) / (there_m - here_m));
  }
  return point + std::min(fraction, 1.0) * glm::dvec3(middle.x - point.x, 0, middle.z - point.z);
}

}  // namespace earshot
