// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/walk_grid.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numeric>
#include <tuple>

#include "sim/nav/motion.h"
#include "sim/nav/navmesh_impl.h"
#include "sim/nav/polygon_outline.h"

namespace earshot {
namespace {

/// Two polygons that share a border both hold a point on it.
constexpr float kSameHeightM = 0.1f;
/// A walk that ends this near to a point, stairs included, has reached it.
constexpr float kReachedM = 0.1f;

struct GridNode {
  std::int64_t row = 0, column = 0;  ///< along z and x
  glm::vec3 foot{0};
  [[nodiscard]] auto order() const { return std::tuple(row, column, foot.y); }
  [[nodiscard]] bool is_same_place(const GridNode& other) const {
    return row == other.row && column == other.column && std::abs(foot.y - other.foot.y) < kSameHeightM;
  }
};

using GridEdge = std::pair<std::uint32_t, std::uint32_t>;

/// Numbers of the first and the last grid line between two coordinates.
std::pair<std::int64_t, std::int64_t> lines_between(double low, double high, double anchor, double spacing) {
  return {static_cast<std::int64_t>(std::ceil((low - anchor) / spacing)), static_cast<std::int64_t>(std::floor((high - anchor) / spacing))};
}

std::vector<GridNode> nodes_of(const Navmesh::Impl& nav, double spacing_m, glm::dvec2 anchor_m,
                               const std::function<bool(glm::vec3)>& is_free) {
  std::vector<GridNode> nodes;
  for (int polygon = 0; polygon < static_cast<int>(nav.surface.polygons().size()); ++polygon) {
    if (nav.surface.polygons()[static_cast<std::size_t>(polygon)].island != nav.main_island) continue;
    const PolygonOutline outline(nav.surface, polygon);
    const auto [least, most] = outline.bounds();
    const auto [first_row, last_row] = lines_between(least.z, most.z, anchor_m.y, spacing_m);
    const auto [first_column, last_column] = lines_between(least.x, most.x, anchor_m.x, spacing_m);
    for (std::int64_t row = first_row; row <= last_row; ++row)
      for (std::int64_t column = first_column; column <= last_column; ++column) {
        const double x = anchor_m.x + static_cast<double>(column) * spacing_m, z = anchor_m.y + static_cast<double>(row) * spacing_m;
        if (!outline.contains(x, z)) continue;
        glm::vec3 foot(x, outline.height_at(x, z), z);
        foot.y = nav.height_at(polygon, foot);
        if (is_free(foot)) nodes.push_back({row, column, foot});
      }
  }
  std::ranges::sort(nodes, {}, &GridNode::order);
  // Not std::ranges: clang 14 takes no subranges of libstdc++ 12.
  nodes.erase(std::unique(nodes.begin(), nodes.end(), [](const GridNode& a, const GridNode& b) { return a.is_same_place(b); }),
              nodes.end());
  return nodes;
}

bool can_walk(const Navmesh& navmesh, glm::vec3 from, glm::vec3 to) {
  const MoveResult moved = slide(navmesh, from, glm::vec3(to.x - from.x, 0, to.z - from.z));
  return !moved.collided && glm::length(moved.position - to) < kReachedM;
}

std::vector<GridEdge> edges_of(const Navmesh& navmesh, const std::vector<GridNode>& nodes) {
  std::vector<GridEdge> edges;
  const auto column_of = [](const GridNode& node) { return std::pair(node.row, node.column); };
  for (std::uint32_t i = 0; i < nodes.size(); ++i)
    for (const auto& [down, right] : {std::pair(0, 1), std::pair(1, 0)}) {
      const std::pair there(nodes[i].row + down, nodes[i].column + right);
      for (auto node = std::ranges::lower_bound(nodes, there, {}, column_of); node != nodes.end() && column_of(*node) == there; ++node)
        if (can_walk(navmesh, nodes[i].foot, node->foot)) edges.emplace_back(i, static_cast<std::uint32_t>(node - nodes.begin()));
    }
  std::ranges::sort(edges);
  return edges;
}

/// For each node the least index of its connected part.
std::vector<std::uint32_t> parts_of(std::size_t num_nodes, const std::vector<GridEdge>& edges) {
  std::vector<std::uint32_t> part(num_nodes);
  std::iota(part.begin(), part.end(), 0U);
  const auto root = [&](std::uint32_t node) {
    while (part[node] != node) node = part[node] = part[part[node]];
    return node;
  };
  for (const auto& [a, b] : edges) {
    const std::uint32_t of_a = root(a), of_b = root(b);
    part[std::max(of_a, of_b)] = std::min(of_a, of_b);
  }
  for (std::uint32_t node = 0; node < num_nodes; ++node) part[node] = root(node);
  return part;
}

WalkGrid largest_part(const std::vector<GridNode>& nodes, const std::vector<GridEdge>& edges) {
  const std::vector<std::uint32_t> part = parts_of(nodes.size(), edges);
  std::vector<std::size_t> size(nodes.size(), 0);
  for (const std::uint32_t of_node : part) ++size[of_node];
  WalkGrid grid;
  if (nodes.empty()) return grid;
  const auto largest = static_cast<std::uint32_t>(std::ranges::max_element(size) - size.begin());
  std::vector<std::uint32_t> index(nodes.size(), 0);
  for (std::size_t node = 0; node < nodes.size(); ++node) {
    if (part[node] != largest) continue;
    index[node] = static_cast<std::uint32_t>(grid.points.size());
    grid.points.push_back(nodes[node].foot);
  }
  for (const auto& [a, b] : edges)
    if (part[a] == largest) grid.edges.emplace_back(index[a], index[b]);
  grid.left_out = nodes.size() - grid.points.size();
  return grid;
}

}  // namespace

WalkGrid make_walk_grid(const Navmesh& navmesh, const WalkGridConfig& config, const std::function<bool(glm::vec3 foot)>& is_free) {
  WalkGrid best;
  for (int down = 0; down < config.shifts_per_axis; ++down)
    for (int right = 0; right < config.shifts_per_axis; ++right) {
      const glm::dvec2 anchor_m = config.anchor_m + config.spacing_m / config.shifts_per_axis * glm::dvec2(right, down);
      const std::vector<GridNode> nodes = nodes_of(navmesh.impl(), config.spacing_m, anchor_m, is_free);
      if (nodes.size() <= best.points.size()) continue;
      WalkGrid grid = largest_part(nodes, edges_of(navmesh, nodes));
      if (grid.points.size() > best.points.size()) best = std::move(grid);
    }
  return best;
}

}  // namespace earshot
