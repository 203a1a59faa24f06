// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "envs/baselines/occupancy_grid.h"

namespace earshot {

struct GridCell {
  int x = 0, z = 0;
  friend bool operator==(const GridCell&, const GridCell&) = default;
};

/// Shortest walks over the free cells of a grid from one cell to all others (Dijkstra 1959, with buckets by cost), in which a metre near an
/// obstacle counts for up to four.  Eight neighbours.  Holds scratch of the grid's size.
class GridPlanner {
 public:
  explicit GridPlanner(float agent_radius_m);

  /// From where the agent stands.  Cells nearer than its radius to an obstacle are crossed only within 0.3 m of it.  0.3 ms for 36 m2.
  void plan(const OccupancyGrid& grid, GridCell from);
  /// Cells that were reached, by rising cost.
  [[nodiscard]] const std::vector<GridCell>& reached() const { return reached_; }
  /// Cost of the walk there in metres of open floor; of a cell that was reached.
  [[nodiscard]] double cost_m(GridCell cell) const;
  [[nodiscard]] bool is_reached(GridCell cell) const;
  /// Whether a reached cell, far enough from obstacles to stand there, borders on the unknown.
  [[nodiscard]] bool is_frontier(const OccupancyGrid& grid, GridCell cell) const;
  /// A cell on the walk to `target`, at most `ahead_m` from the start by air: where to head for.
  [[nodiscard]] GridCell waypoint(GridCell target, double ahead_m) const;

 private:
  [[nodiscard]] int factor(const OccupancyGrid& grid, int x, int z) const;  ///< 0: not crossed

  int radius_cells_;
  GridCell from_;
  std::vector<std::int32_t> cost_;   ///< in tenths of a cell; -1: not reached
  std::vector<std::int8_t> parent_;  ///< direction from which it was reached
  std::vector<GridCell> reached_;
  std::vector<std::vector<GridCell>> buckets_;
};

}  // namespace earshot
