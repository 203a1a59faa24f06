// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/walkable_map.h"

#include <algorithm>
#include <glm/common.hpp>
#include <limits>

#include "sim/nav/navmesh_impl.h"
#include "sim/nav/polygon_outline.h"

namespace earshot {
namespace {

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
    const PolygonOutline outline(nav.surface, polygon);
    const auto [least, most] = outline.bounds();
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
    const PolygonOutline outline(nav.surface, polygon);
    const auto [low, high] = outline.bounds();
    least = glm::min(least, low);
    most = glm::max(most, high);
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
