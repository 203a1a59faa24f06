// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <utility>
#include <vector>

#include "sim/nav/navmesh.h"

namespace earshot {

struct WalkGridConfig {
  double spacing_m = 1;     ///< between neighbours along x and along z, seen from above
  glm::dvec2 anchor_m{0};   ///< (x, z) that grids are counted from
  int shifts_per_axis = 8;  ///< grids that are tried, each shifted from the one before by this fraction of the spacing
};

/// Points of a square grid on the walkable surface, and which of them a straight walk joins.
struct WalkGrid {
  std::vector<glm::vec3> points;                               ///< foot points, by z, then x, then height
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;  ///< of neighbours along x or z, the smaller index first; sorted
  std::size_t left_out = 0;                                    ///< points of the same grid that no walk along edges joins to `points`
};

/// The grid on the main island of a navmesh whose largest connected part has most points, among shifts_per_axis^2 shifted ones: a grid of
/// 1 m passes through few doorways of a house wherever it begins.  Only that part is returned, so every point can be reached from every
/// other along edges.  A column of the grid has a point on each storey.  is_free: whether a foot point can be used.  The same arguments
/// give the same grid.  Cost: about 5 us per point and shift, and is_free.  Returns no point where none is free.
WalkGrid make_walk_grid(const Navmesh& navmesh, const WalkGridConfig& config, const std::function<bool(glm::vec3 foot)>& is_free);

}  // namespace earshot
