// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/grid_planner.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace earshot {
namespace {

constexpr std::array<GridCell, 8> kMoves = {{{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}}};
constexpr int kStraight = 10, kDiagonal = 14, kLargestFactor = 8;
constexpr int kNearStart_cells = 6;
constexpr std::size_t kBuckets = static_cast<std::size_t>(kDiagonal) * kLargestFactor + 1;

}  // namespace

GridPlanner::GridPlanner(float agent_radius_m)
    : radius_cells_(static_cast<int>(std::ceil(static_cast<double>(agent_radius_m) / OccupancyGrid::kCell_m - 1e-3))), buckets_(kBuckets) {
  constexpr auto cells = static_cast<std::size_t>(OccupancyGrid::kSize) * OccupancyGrid::kSize;
  cost_.assign(cells, -1);
  parent_.assign(cells, -1);
}

int GridPlanner::factor(const OccupancyGrid& grid, int x, int z) const {
  if (!OccupancyGrid::inside(x, z) || grid.at(x, z) != OccupancyGrid::Cell::free) return 0;
  const int clear = grid.clearance(x, z) - std::min(radius_cells_, OccupancyGrid::kReach - 2);
  if (clear < 0) return std::max(std::abs(x - from_.x), std::abs(z - from_.z)) <= kNearStart_cells ? kLargestFactor : 0;
  return clear == 0 ? 4 : clear == 1 ? 2 : 1;
}

void GridPlanner::plan(const OccupancyGrid& grid, GridCell from) {
  for (const GridCell cell : reached_) cost_[OccupancyGrid::index(cell.x, cell.z)] = -1;
  reached_.clear();
  from_ = from;
  if (!OccupancyGrid::inside(from.x, from.z)) return;
  cost_[OccupancyGrid::index(from.x, from.z)] = 0;
  parent_[OccupancyGrid::index(from.x, from.z)] = -1;
  buckets_[0] = {from};
  std::size_t waiting = 1;
  for (std::int32_t cost = 0; waiting > 0; ++cost) {
    auto& bucket = buckets_[static_cast<std::size_t>(cost) % kBuckets];
    for (const GridCell cell : bucket) {
      --waiting;
      if (cost_[OccupancyGrid::index(cell.x, cell.z)] != cost) continue;  // reached for less
      reached_.push_back(cell);
      for (std::size_t move = 0; move < kMoves.size(); ++move) {
        const int x = cell.x + kMoves[move].x, z = cell.z + kMoves[move].z, times = factor(grid, x, z);
        if (times == 0) continue;
        const std::int32_t next_cost = cost + times * (move < 4 ? kStraight : kDiagonal);
        std::int32_t& known = cost_[OccupancyGrid::index(x, z)];
        if (known >= 0 && known <= next_cost) continue;
        known = next_cost;
        parent_[OccupancyGrid::index(x, z)] = static_cast<std::int8_t>(move);
        buckets_[static_cast<std::size_t>(next_cost) % kBuckets].push_back({x, z});
        ++waiting;
      }
    }
    bucket.clear();
  }
}

double GridPlanner::cost_m(GridCell cell) const {
  return cost_[OccupancyGrid::index(cell.x, cell.z)] * (OccupancyGrid::kCell_m / kStraight);
}

bool GridPlanner::is_reached(GridCell cell) const {
  return OccupancyGrid::inside(cell.x, cell.z) && cost_[OccupancyGrid::index(cell.x, cell.z)] >= 0;
}

bool GridPlanner::is_frontier(const OccupancyGrid& grid, GridCell cell) const {
  if (!is_reached(cell) || grid.clearance(cell.x, cell.z) < radius_cells_) return false;
  int unknown = 0;
  for (const GridCell move : kMoves)
    unknown += OccupancyGrid::inside(cell.x + move.x, cell.z + move.z) &&
               grid.at(cell.x + move.x, cell.z + move.z) == OccupancyGrid::Cell::unknown;
  return unknown >= 2;
}

GridCell GridPlanner::waypoint(GridCell target, double ahead_m) const {
  GridCell cell = target;
  while (!(cell == from_) && std::hypot(cell.x - from_.x, cell.z - from_.z) * OccupancyGrid::kCell_m > ahead_m) {
    const GridCell move = kMoves[static_cast<std::size_t>(parent_[OccupancyGrid::index(cell.x, cell.z)])];
    cell = {cell.x - move.x, cell.z - move.z};
  }
  return cell;
}

}  // namespace earshot
