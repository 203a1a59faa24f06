// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/walk_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <set>

#include "sim/base/random.h"
#include "tests/support/envs/nav_scenes.h"

namespace earshot {
namespace {

using Edges = std::set<std::pair<std::uint32_t, std::uint32_t>>;

bool everywhere(glm::vec3) { return true; }

RandomStream drawn(std::uint32_t number) { return {77, Purpose::episode, 1, number, 0}; }

/// Pairs of points one spacing apart along x or z, and whether the shortest walk between them is straight.
void expect_edges_are_straight_walks(const Navmesh& nav, const WalkGrid& grid, double spacing_m) {
  const Edges edges(grid.edges.begin(), grid.edges.end());
  EXPECT_EQ(edges.size(), grid.edges.size());
  EXPECT_TRUE(std::ranges::is_sorted(grid.edges));
  std::size_t neighbours = 0;
  for (std::uint32_t a = 0; a < grid.points.size(); ++a)
    for (std::uint32_t b = a + 1; b < grid.points.size(); ++b) {
      const glm::vec3 step = grid.points[b] - grid.points[a];
      const bool along_axis = std::min(std::abs(step.x), std::abs(step.z)) < 1e-4f;
      const bool is_neighbour = along_axis && std::abs(std::hypot(step.x, step.z) - static_cast<float>(spacing_m)) < 1e-4f;
      if (!is_neighbour) {
        EXPECT_FALSE(edges.contains({a, b}));
        continue;
      }
      ++neighbours;
      // The corridor of Detour cuts no corner: longer by a hair at most where the straight line is free.
      const auto length_m = nav.path_length_m(grid.points[a], grid.points[b]);
      ASSERT_TRUE(length_m);
      if (*length_m > 1.01 * spacing_m) {
        EXPECT_FALSE(edges.contains({a, b})) << *length_m;
      } else if (*length_m < 1.00001 * spacing_m) {
        EXPECT_TRUE(edges.contains({a, b})) << *length_m;
      }
    }
  EXPECT_GE(neighbours, edges.size());
}

bool is_connected(const WalkGrid& grid) {
  std::vector<std::uint32_t> reached{0};
  std::set<std::uint32_t> seen{0};
  while (!reached.empty()) {
    const std::uint32_t at = reached.back();
    reached.pop_back();
    for (const auto& [a, b] : grid.edges)
      for (const auto& [from, to] : {std::pair(a, b), std::pair(b, a)})
        if (from == at && seen.insert(to).second) reached.push_back(to);
  }
  return seen.size() == grid.points.size();
}

TEST(WalkGrid, AnEmptyFloorHoldsAllPointsOfItsBestShift) {
  for (std::uint32_t number = 0; number < 6; ++number) {
    const RandomStream random = drawn(number);
    const float width_m = 2 + 5 * random.uniform(0), depth_m = 2 + 5 * random.uniform(1);
    const double spacing_m = 0.3 + 0.7 * static_cast<double>(random.uniform(2));
    const Navmesh nav(floor_with(width_m, depth_m, {}), {});
    const WalkGrid grid = make_walk_grid(nav, {.spacing_m = spacing_m}, everywhere);
    // Borders keep 0.05 to 0.2 m from the edge of the floor; of any interval of length L, some shift of a grid of 8 holds at least
    // floor((L - spacing / 8) / spacing) + 1 lines, and none more than floor(L / spacing) + 1.
    const auto lines = [&](double length_m) { return std::floor(length_m / spacing_m) + 1; };
    const double least = lines(width_m - 0.4 - spacing_m / 8) * lines(depth_m - 0.4 - spacing_m / 8);
    const double most = lines(width_m - 0.1) * lines(depth_m - 0.1);
    EXPECT_GE(static_cast<double>(grid.points.size()), least) << width_m << " " << depth_m << " " << spacing_m;
    EXPECT_LE(static_cast<double>(grid.points.size()), most) << width_m << " " << depth_m << " " << spacing_m;
    EXPECT_EQ(grid.left_out, 0u);
    EXPECT_TRUE(is_connected(grid));
    expect_edges_are_straight_walks(nav, grid, spacing_m);
    // A full rectangle of c columns and r rows has c (r - 1) + r (c - 1) edges.
    std::set<float> columns, rows;
    for (const glm::vec3 point : grid.points) {
      columns.insert(point.x);
      rows.insert(point.z);
      EXPECT_NEAR(point.y, 0.f, 1e-5f);
    }
    ASSERT_EQ(grid.points.size(), columns.size() * rows.size());
    EXPECT_EQ(grid.edges.size(), columns.size() * (rows.size() - 1) + rows.size() * (columns.size() - 1));
  }
}

TEST(WalkGrid, ObstaclesTakePointsAndEdges) {
  for (std::uint32_t number = 0; number < 6; ++number) {
    const RandomStream random = drawn(100 + number);
    TriangleMesh mesh = floor_with(7, 6, {});
    for (std::uint32_t block = 0; block < 4; ++block) {
      const float x = 0.5f + 5 * random.uniform(4 * block), z = 0.5f + 4 * random.uniform(4 * block + 1);
      append_block(mesh, x, z, x + 0.1f + random.uniform(4 * block + 2), z + 0.1f + random.uniform(4 * block + 3));
    }
    const Navmesh nav(mesh, {});
    const double spacing_m = 0.5;
    const glm::dvec2 anchor_m(random.uniform(20), random.uniform(21));
    const WalkGrid grid = make_walk_grid(nav, {.spacing_m = spacing_m, .anchor_m = anchor_m}, everywhere);
    ASSERT_GT(grid.points.size(), 30u);
    EXPECT_TRUE(is_connected(grid));
    expect_edges_are_straight_walks(nav, grid, spacing_m);
    for (const glm::vec3 point : grid.points) {
      const auto on_floor = nav.snap(point, 0.01f);
      ASSERT_TRUE(on_floor);
      EXPECT_LT(glm::length(*on_floor - point), 1e-3f);
      const double lines = (static_cast<double>(point.x) - anchor_m.x) / spacing_m * 8;  // of all shifts
      EXPECT_NEAR(lines, std::round(lines), 1e-4);
    }
    EXPECT_TRUE(std::ranges::is_sorted(grid.points, {}, [](glm::vec3 p) { return std::pair(std::lround(1e3 * p.z), p.x); }));
    const WalkGrid again = make_walk_grid(nav, {.spacing_m = spacing_m, .anchor_m = anchor_m}, everywhere);
    EXPECT_EQ(again.points, grid.points);
    EXPECT_EQ(again.edges, grid.edges);
  }
}

// Two rooms and a door of 0.9 m anywhere: a grid of 1 m has lines through it only by some of its shifts.
TEST(WalkGrid, AShiftOfTheGridPassesThroughTheDoor) {
  for (std::uint32_t number = 0; number < 8; ++number) {
    const RandomStream random = drawn(200 + number);
    const float door = 0.6f + 3.f * random.uniform(0), wall = 3 + random.uniform(1);
    TriangleMesh mesh = floor_with(7.3f, 5.2f, {});
    append_block(mesh, wall, -0.1f, wall + 0.1f, door);
    append_block(mesh, wall, door + 0.9f, wall + 0.1f, 5.3f);
    const Navmesh nav(mesh, {});
    const WalkGrid grid = make_walk_grid(nav, {.spacing_m = 1}, everywhere);
    const auto beyond = std::ranges::count_if(grid.points, [&](glm::vec3 point) { return point.x > wall; });
    EXPECT_GE(beyond, 10) << door;
    EXPECT_GE(static_cast<std::ptrdiff_t>(grid.points.size()) - beyond, 8) << door;
    EXPECT_TRUE(is_connected(grid));
  }
}

// Two storeys joined by a ramp, one above the other: a column has a point on each.
TEST(WalkGrid, StoreysHavePointsOfTheirOwn) {
  TriangleMesh mesh = floor_with(8, 3, {});
  append_floor(mesh, 0, 0, 4, 3, 2.5f);
  append_floor(mesh, 4, 0, 8, 1.4f, 2.5f);
  // From (8, 0) to (14, 2.5), along x, with landings that meet the floors.
  append_floor(mesh, 8, 0, 15, 3, 0);
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), {{14, 0, 0}, {8, 2.5f, 0}, {8, 2.5f, 1.4f}, {14, 0, 1.4f}});
  for (const glm::uvec3 t : {glm::uvec3{0, 1, 2}, glm::uvec3{0, 2, 3}}) {
    mesh.triangles.push_back(t + glm::uvec3(first));
    mesh.triangle_material.push_back(0);
    mesh.triangle_object.push_back(0);
  }
  const Navmesh nav(mesh, {});
  const WalkGrid grid = make_walk_grid(nav, {.spacing_m = 0.5}, everywhere);
  EXPECT_TRUE(is_connected(grid));
  const auto above = std::ranges::count_if(grid.points, [](glm::vec3 p) { return p.y > 2.4f && p.x < 4; });
  const auto below = std::ranges::count_if(grid.points, [](glm::vec3 p) { return p.y < 0.1f && p.x < 4; });
  EXPECT_GE(above, 30);
  EXPECT_GE(below, 30);
}

TEST(WalkGrid, OnlyFreePointsAreTaken) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  const WalkGrid left = make_walk_grid(nav, {.spacing_m = 0.5}, [](glm::vec3 foot) { return foot.x < 2; });
  ASSERT_FALSE(left.points.empty());
  for (const glm::vec3 point : left.points) EXPECT_LT(point.x, 2.f);
  // Of two parts the larger.
  const WalkGrid larger = make_walk_grid(nav, {.spacing_m = 0.5}, [](glm::vec3 foot) { return foot.x < 2 || foot.x > 3; });
  for (const glm::vec3 point : larger.points) EXPECT_GT(point.x, 3.f);
  EXPECT_GE(larger.left_out, left.points.size() / 2);
  EXPECT_TRUE(make_walk_grid(nav, {}, [](glm::vec3) { return false; }).points.empty());
}

}  // namespace
}  // namespace earshot
