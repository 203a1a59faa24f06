// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/occupancy_grid.h"

#include <gtest/gtest.h>

#include <numbers>

#include "envs/baselines/grid_planner.h"
#include "tests/support/envs/env_fixture.h"

namespace earshot {
namespace {

/// A map made by turning once around in the middle of a room of 6 x 5 m.
OccupancyGrid map_of_room() {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = false;
  config.observation.camera.width_px = config.observation.camera.height_px = 64;
  config.task.max_steps = 100;
  BatchedEnv env(config, make_set({room_episode("shoebox:6x3x5@0.5", {3, 0, 2.5f}, 0, {1, 0, 1}, "synth:noise")}), make_scene_cache(config),
                 1);
  env.reset();
  OccupancyGrid grid(config.observation.camera, config.navmesh);
  const std::vector<std::int32_t> left = {static_cast<std::int32_t>(Action::left)};
  for (int turn = 0; turn < 36; ++turn) {
    grid.add({.heading_rad = turn * 10 * std::numbers::pi / 180}, float_rows(env, "depth"));
    env.step(left);
  }
  return grid;
}

TEST(OccupancyGrid, WallsOfARoomAreWhereTheyAre) {
  const OccupancyGrid grid = map_of_room();
  const double tolerance_m = 1.5 * OccupancyGrid::kCell_m;  // half a cell's diagonal, and a cell of rounding
  int free = 0;
  for (int z = 0; z < OccupancyGrid::kSize; ++z)
    for (int x = 0; x < OccupancyGrid::kSize; ++x) {
      const double x_m = OccupancyGrid::centre_of(x), z_m = OccupancyGrid::centre_of(z);
      const double outside_m = std::max(std::abs(x_m) - 3.0, std::abs(z_m) - 2.5);  // 0 on a wall
      if (grid.at(x, z) == OccupancyGrid::Cell::occupied) {
        EXPECT_NEAR(outside_m, 0, tolerance_m) << x_m << " " << z_m;
      }
      if (grid.at(x, z) == OccupancyGrid::Cell::free) {
        EXPECT_LT(outside_m, tolerance_m);
        ++free;
      }
    }
  EXPECT_NEAR(free * OccupancyGrid::kCell_m * OccupancyGrid::kCell_m, 30, 1.5);  // all of the floor, to 5 %
  int holes = 0;
  for (double s = -2.4; s < 2.4; s += OccupancyGrid::kCell_m)
    for (const auto& [x_m, z_m] : {std::pair{3.0, s}, {-3.0, s}, {s, 2.5}, {s, -2.5}})
      holes += grid.clearance(OccupancyGrid::cell_of(x_m), OccupancyGrid::cell_of(z_m)) > 2;
  EXPECT_EQ(holes, 0);
}

TEST(OccupancyGrid, ThePictureFitsTheMapWhereItWasTaken) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = false;
  config.observation.camera.width_px = config.observation.camera.height_px = 64;
  BatchedEnv env(config, make_set({room_episode("shoebox:6x3x5@0.5", {3, 0, 2.5f}, 0.4, {1, 0, 1}, "synth:noise")}),
                 make_scene_cache(config), 1);
  env.reset();
  const OccupancyGrid grid = map_of_room();
  const PlanarPose start{.heading_rad = 0.4};
  const double fit = grid.misfit(start, float_rows(env, "depth"));
  for (const PlanarPose away : {PlanarPose{0.15, 0, 0.4}, PlanarPose{-0.15, 0, 0.4}, PlanarPose{0, 0.15, 0.4}, PlanarPose{0, -0.15, 0.4}})
    EXPECT_GT(grid.misfit(away, float_rows(env, "depth")), fit + 10);
}

TEST(GridPlanner, WalksStraightInTheOpenAndKnowsWhatIsUnknown) {
  const OccupancyGrid grid = map_of_room();
  GridPlanner planner(0.1f);
  const GridCell start{OccupancyGrid::cell_of(0), OccupancyGrid::cell_of(0)}, end{OccupancyGrid::cell_of(2), OccupancyGrid::cell_of(0)};
  planner.plan(grid, start);
  ASSERT_TRUE(planner.is_reached(end));
  EXPECT_NEAR(planner.cost_m(end), 2.0, 1e-9);
  EXPECT_EQ(planner.waypoint(end, 0.4), (GridCell{start.x + 8, start.z}));
  EXPECT_FALSE(planner.is_reached({OccupancyGrid::cell_of(3.5), start.z}));  // through the wall
  EXPECT_FALSE(planner.is_frontier(grid, end));                              // all around it is seen
}

TEST(GridPlanner, GoesAroundWhatStandsInTheWay) {
  OccupancyGrid grid = map_of_room();
  for (double z_m = -1.5; z_m <= 1.5; z_m += 0.5 * OccupancyGrid::kCell_m) grid.mark_occupied(1.0, z_m);
  GridPlanner planner(0.1f);
  const GridCell start{OccupancyGrid::cell_of(0), OccupancyGrid::cell_of(0)}, end{OccupancyGrid::cell_of(2), OccupancyGrid::cell_of(0)};
  planner.plan(grid, start);
  ASSERT_TRUE(planner.is_reached(end));
  EXPECT_GT(planner.cost_m(end), 2 * std::hypot(1.0, 1.6));  // by way of the end of the wall
  EXPECT_LT(planner.cost_m(end), 2 * std::hypot(1.0, 1.6) * 1.3 + 1);
}

}  // namespace
}  // namespace earshot
