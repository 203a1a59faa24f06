// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/walkable_map.h"

#include <algorithm>
#include <array>
#include <glm/common.hpp>
#include <limits>

#include "sim/nav/navmesh_impl.h"

namespace earshot {
namespace {

/// A polygon of the surface as seen from above.
struct Outline {
  std::array<glm::dvec3, Surface::kMaxCorners> corners{};
  int count = 0;

  Outline(const Surface& surface, int polygon) : count(surface.polygons()[static_cast<std::size_t>(polygon)].num_corners) {
    for (int i = 0; i < count; ++i) corners[static_cast<std::size_t>(i)] = surface.vertex(polygon, i);
  }
  [[nodiscard]] std::span<const glm::dvec3> points() const { return std::span(corners).first(static_cast<std::size_t>(count)); }

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

/// Calls found(cell, height) for each cell whose middle lies in a polygon of the main island.
template <class Found>
void visit_cells(const Navmesh::Impl& nav, glm::dvec2 low, double cell_m, std::size_t columns, std::size_t rows, const Found& found) {
  const auto cells_between = [&](double from, double to, std::size_t count) {
    const double last = static_cast<double>(count) - 1;
    return std::pair(static_cast<std::size_t>(std::clamp(std::ceil(from / cell_m - 0.5), 0.0, last)),
                     static_cast<std::size_t>(std::clamp(std::floor(to / cell_m - 0.5) + 1, 0.0, last)));
  };
  for (int polygon = 0; polygon < static_cast<int>(nav.surface.polygons().size()); ++polygon) {
    if (nav.surface.polygons()[static_cast<std::size_t>(polygon)].island != nav.main_island) continue;
    const Outline outline(nav.surface, polygon);
    glm::dvec3 least = outline.corners[0], most = outline.corners[0];
    for (const glm::dvec3& corner : outline.points()) {
      least = glm::min(least, corner);
      most = glm::max(most, corner);
    }
    const auto [first_column, last_column] = cells_between(least.x - low.x, most.x - low.x, columns);
    const auto [first_row, last_row] = cells_between(least.z - low.y, most.z - low.y, rows);
    for (std::size_t row = first_row; row <= last_row; ++row)
      for (std::size_t column = first_column; column <= last_column; ++column) {
        const double x = low.x + (static_cast<double>(column) + 0.5) * cell_m, z = low.y + (static_cast<double>(row) + 0.5) * cell_m;
        if (outline.contains(x, z)) found(row * columns + column, static_cast<float>(outline.height_at(x, z)));
      }
  }
}

}  // namespace

WalkableMap::WalkableMap(const Navmesh& navmesh) {
  const Navmesh::Impl& nav = navmesh.impl();
  glm::dvec3 least(std::numeric_limits<double>::infinity()), most = -least;
  for (int polygon = 0; polygon < static_cast<int>(nav.surface.polygons().size()); ++polygon) {
    if (nav.surface.polygons()[static_cast<std::size_t>(polygon)].island != nav.main_island) continue;
    const Outline outline(nav.surface, polygon);
    for (const glm::dvec3& corner : outline.points()) {
      least = glm::min(least, corner);
      most = glm::max(most, corner);
    }
  }
  const double width_m = std::max(0.0, most.x - least.x), depth_m = std::max(0.0, most.z - least.z);
  double cell_m = static_cast<double>(nav.config.cell_size_m);
  cell_m = std::max(cell_m, std::sqrt(width_m * depth_m / static_cast<double>(kMaxCells)));
  const auto cells = [&](double length_m) { return static_cast<std::size_t>(std::ceil(length_m / cell_m)) + 1; };
  const std::size_t columns = cells(width_m), rows = cells(depth_m);
  low_ = glm::vec2(static_cast<float>(least.x), static_cast<float>(least.z));
  per_m_ = static_cast<float>(1.0 / cell_m);
  columns_ = static_cast<float>(columns);
  rows_ = static_cast<float>(rows);

  const glm::dvec2 low(least.x, least.z);
  first_.assign(columns * rows + 1, 0);
  visit_cells(nav, low, cell_m, columns, rows, [&](std::size_t cell, float) { ++first_[cell + 1]; });
  for (std::size_t cell = 0; cell < columns * rows; ++cell) first_[cell + 1] += first_[cell];
  heights_.resize(first_.back());
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  visit_cells(nav, low, cell_m, columns, rows, [&](std::size_t cell, float height) { heights_[next[cell]++] = height; });
}

}  // namespace earshot
