// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/navmesh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/generators/house_generator.h"
#include "tests/support/envs/nav_scenes.h"

namespace earshot {
namespace {

// Borders keep the agent's radius from walls: 0.1 m, up to 0.15 m because cells are 0.05 m, and less by as much where contours are
// straightened.
constexpr float kMinClearanceM = 0.05f, kMaxClearanceM = 0.2f;

TEST(Navmesh, OpenFloorIsWalkableUpToTheAgentsRadius) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  EXPECT_EQ(nav.num_islands(), 1);
  EXPECT_GT(nav.area_m2(), (6 - 2 * kMaxClearanceM) * (4 - 2 * kMaxClearanceM));
  EXPECT_LT(nav.area_m2(), (6 - 2 * kMinClearanceM) * (4 - 2 * kMinClearanceM));
  const auto middle = nav.snap({3, 0.4f, 2});
  ASSERT_TRUE(middle);
  EXPECT_EQ(middle->x, 3.f);
  EXPECT_EQ(middle->z, 2.f);
  EXPECT_NEAR(middle->y, 0.f, 1e-5f);  // the floor itself, not the top of its voxel
}

TEST(Navmesh, LargerAgentsKeepLargerDistance) {
  const TriangleMesh mesh = floor_with(6, 4, {});
  for (const float radius_m : {0.1f, 0.2f, 0.4f}) {
    const Navmesh nav(mesh, {.agent_radius_m = radius_m});
    const auto border = nav.snap({-0.2f, 0, 2}, 1.f);
    ASSERT_TRUE(border);
    EXPECT_GE(border->x, radius_m - 0.05f);  // one cell
    EXPECT_LE(border->x, radius_m + 0.1f);   // two cells
  }
}

TEST(Navmesh, ObstaclesAreCutOut) {
  const Navmesh nav(floor_with(6, 4, {{2, 1, 4, 3}}), {});
  EXPECT_FALSE(nav.snap({3, 0, 2}, 0.5f));
  const auto beside = nav.snap({3, 0, 2}, 2.f);
  ASSERT_TRUE(beside);
  EXPECT_NEAR(std::min({std::abs(beside->x - 2), std::abs(beside->x - 4), std::abs(beside->z - 1), std::abs(beside->z - 3)}), 0.125f,
              0.075f);
}

TEST(Navmesh, SnapKeepsToItsReach) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  EXPECT_FALSE(nav.snap({-0.5f, 0, 2}, 0.5f));
  EXPECT_TRUE(nav.snap({-0.3f, 0, 2}, 0.5f));
  EXPECT_FALSE(nav.snap({-0.33f, 0, -0.33f}, 0.5f));  // 0.45 m per axis, but 0.63 m away
  EXPECT_TRUE(nav.snap({3, 0.95f, 2}));
  EXPECT_FALSE(nav.snap({3, 1.6f, 2}));
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(nav.snap({nan, 0, 2}));
  EXPECT_FALSE(nav.snap({3, 0, infinity}));
}

TEST(Navmesh, LowCeilingsAndStepsLimitTheAgent) {
  TriangleMesh mesh = floor_with(8, 4, {});
  append_block(mesh, 5, 0.01f, 7, 3.99f, 1.6f, 1.4f);  // a beam 1.4 m above the floor: too low for 1.5 m
  append_block(mesh, 1, 1, 2, 2, 0.15f);               // a step of 15 cm can be climbed,
  append_block(mesh, 3, 1, 4, 2, 0.30f);               // one of 30 cm cannot
  const Navmesh nav(mesh, {});
  EXPECT_FALSE(nav.snap({6, 0, 2}, 0.3f));
  EXPECT_TRUE(nav.path_length_m({0.5f, 0, 3.5f}, {1.5f, 0.15f, 1.5f}));
  EXPECT_FALSE(nav.path_length_m({0.5f, 0, 3.5f}, {3.5f, 0.30f, 1.5f}));
}

TEST(Navmesh, IslandsAreCountedAndSmallOnesDropped) {
  TriangleMesh mesh = floor_with(6, 4, {{2.9f, 0, 3.1f, 4}});
  append_floor(mesh, 10, 0, 10.6f, 0.6f);  // 0.16 m2 after erosion
  const Navmesh nav(mesh, {});
  EXPECT_EQ(nav.num_islands(), 2);
  EXPECT_FALSE(nav.snap({10.3f, 0, 0.3f}));
  EXPECT_FALSE(nav.path_length_m({1, 0, 2}, {5, 0, 2}));
  EXPECT_TRUE(nav.path_length_m({1, 0, 1}, {1, 0, 3}));
}

TEST(Navmesh, StartsAreDrawnUniformlyFromTheLargestIsland) {
  // The left part has 5.6 m of 8.4 m after the wall; the right one and the table are never drawn.
  TriangleMesh mesh = floor_with(9, 4, {{6, 0, 6.2f, 4}});
  append_block(mesh, 1, 1, 3, 3, 0.75f);
  const Navmesh nav(mesh, {});
  EXPECT_EQ(nav.num_islands(), 3);
  const RandomStream random(7, Purpose::test);
  constexpr int count = 20000;
  int in_front = 0;
  for (int i = 0; i < count; ++i) {
    const glm::vec3 point = nav.random_point(random, static_cast<std::uint32_t>(2 * i));
    ASSERT_LT(point.x, 6.f);
    ASSERT_NEAR(point.y, 0.f, 1e-5f);
    ASSERT_FALSE(point.x > 1 && point.x < 3 && point.z > 1 && point.z < 3);
    in_front += point.x > 3.2f;  // a rectangle free of obstacles: 3.2 to the wall
  }
  // Its fraction of the area, both from the erosion that the border shows.
  const float left = nav.snap({-0.2f, 0, 2}, 1.f)->x, right = nav.snap({5.95f, 0, 2}, 1.f)->x, near = nav.snap({5, 0, -0.2f}, 1.f)->z,
              far = nav.snap({5, 0, 4.2f}, 1.f)->z;
  const float hole_x0 = nav.snap({1.2f, 0, 2}, 1.f)->x, hole_x1 = nav.snap({2.8f, 0, 2}, 1.f)->x, hole_z0 = nav.snap({2, 0, 1.2f}, 1.f)->z,
              hole_z1 = nav.snap({2, 0, 2.8f}, 1.f)->z;
  const double total = (right - left) * (far - near) - (hole_x1 - hole_x0) * (hole_z1 - hole_z0);
  const double fraction = (right - 3.2f) * (far - near) / total;
  // Four sigma of a binomial count, and 1 % for corners of the hole that contours cut.
  EXPECT_NEAR(in_front / static_cast<double>(count), fraction, 4 * std::sqrt(fraction * (1 - fraction) / count) + 0.01);
}

TEST(Navmesh, SameDrawGivesTheSamePoint) {
  const Navmesh nav(generate_house({.seed = 3, .rooms = 3, .area_m2 = 36}), {});
  const RandomStream random(1, Purpose::test, 2, 3);
  const glm::vec3 point = nav.random_point(random, 40);
  EXPECT_EQ(point, nav.random_point(random, 40));
  EXPECT_NE(point, nav.random_point(random, 42));
}

TEST(Navmesh, InsideOutMeshesStillHaveAFloor) {
  TriangleMesh mesh = floor_with(6, 4, {});
  for (glm::uvec3& t : mesh.triangles) std::swap(t.y, t.z);
  EXPECT_NEAR(Navmesh(mesh, {}).area_m2(), 6 * 4 - 2 * 0.125f * 10, 1.5f);
}

TEST(Navmesh, MainIslandIsIndoorsNotTheRoof) {
  TriangleMesh mesh;
  append_floor(mesh, 0, 0, 6, 6);
  for (const Block& wall : {Block{0, 0, 0.2f, 6}, {5.8f, 0, 6, 6}, {0, 0, 6, 0.2f}, {0, 5.8f, 6, 6}})
    append_block(mesh, wall.x0, wall.z0, wall.x1, wall.z1);
  append_block(mesh, -1, -1, 7, 7, 2.7f, 2.45f);  // larger than the floor, and flat
  const Navmesh nav(mesh, {});
  const RandomStream random(7, Purpose::test);
  for (std::uint32_t i = 0; i < 50; ++i) EXPECT_NEAR(nav.random_point(random, 2 * i).y, 0.f, 1e-4f);
}

TEST(Navmesh, RefusesMeshesWithNothingToStandOn) {
  EXPECT_THROW(Navmesh(TriangleMesh{}, {}), InputError);
  TriangleMesh ledge;
  append_floor(ledge, 0, 0, 0.15f, 5);  // narrower than the agent
  EXPECT_THROW(Navmesh(ledge, {}), InputError);
  EXPECT_THROW(Navmesh(floor_with(1e5f, 1e5f, {}), {}), InputError);  // 4e12 cells: a wrong unit
}

TEST(Navmesh, RefusesBadSettings) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NO_THROW(validate(NavmeshConfig{}));
  EXPECT_THROW(validate({.agent_radius_m = 0}), InputError);
  EXPECT_THROW(validate({.agent_radius_m = nan}), InputError);
  EXPECT_THROW(validate({.agent_height_m = -1}), InputError);
  EXPECT_THROW(validate({.max_climb_m = 2}), InputError);
  EXPECT_THROW(validate({.max_slope_deg = 90}), InputError);
  EXPECT_THROW(validate({.cell_size_m = 0}), InputError);
  EXPECT_THROW(validate({.cell_height_m = nan}), InputError);
  EXPECT_THROW(validate({.min_region_area_m2 = -1}), InputError);
}

}  // namespace
}  // namespace earshot
