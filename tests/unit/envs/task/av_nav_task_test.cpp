// SPDX-License-Identifier: Apache-2.0
#include "envs/task/av_nav_task.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// A flat floor of size_m x size_m around (center_x, 0, 0): paths are straight lines, so every distance has a closed form.
TriangleMesh floor_mesh(float size_m, float center_x = 0) {
  TriangleMesh mesh;
  const float h = size_m / 2;
  mesh.vertices = {{center_x - h, 0, -h}, {center_x + h, 0, -h}, {center_x + h, 0, h}, {center_x - h, 0, h}};
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}};
  mesh.triangle_material = mesh.triangle_object = {0, 0};
  mesh.material_names = mesh.object_names = {"floor"};
  return mesh;
}

/// The surface is exact in x and z; its height is known to a cell (5 cm), the same everywhere on a flat floor.  Floats: 1e-6 per step.
constexpr double kTolerance_m = 2e-4;

class AvNavTask : public testing::Test {
 protected:
  AvNavTask() : navmesh_(floor_mesh(14), NavmeshConfig{}), field_(navmesh_, {0, 0, -3}), start_(*navmesh_.snap({0, 0, 0})) {
    state_.begin(task_, field_, start_, 0.0, 12);
  }
  float step(Action action) { return state_.step(task_, navmesh_, field_, action); }
  double step_times(int count, Action action) {
    double reward = 0;
    for (int i = 0; i < count; ++i) reward += static_cast<double>(step(action));
    return reward;
  }

  TaskConfig task_;
  Navmesh navmesh_;
  GeodesicField field_;
  glm::vec3 start_;
  AvNavState state_;
};

TEST_F(AvNavTask, ForwardWalksAlongMinusZAndPaysTheDistance) {
  EXPECT_NEAR(state_.distance_to_goal_m(), 3.0, kTolerance_m);
  EXPECT_NEAR(step(Action::forward), -0.01 + 0.15, kTolerance_m);
  EXPECT_NEAR(state_.pose(task_).position.z, -0.15, kTolerance_m);
  EXPECT_NEAR(state_.pose(task_).position.x, 0.0, kTolerance_m);
  EXPECT_NEAR(state_.distance_to_goal_m(), 2.85, kTolerance_m);
  EXPECT_FALSE(state_.collided());
}

TEST_F(AvNavTask, TurnsCostAStepAndLeadToTheSide) {
  EXPECT_FLOAT_EQ(step(Action::left), -0.01f);
  EXPECT_NEAR(state_.pose(task_).heading_rad, 10 * std::numbers::pi / 180, 1e-12);
  EXPECT_FLOAT_EQ(step(Action::right), -0.01f);
  EXPECT_FLOAT_EQ(step(Action::right), -0.01f);
  EXPECT_NEAR(std::remainder(state_.pose(task_).heading_rad, 2 * std::numbers::pi), -10 * std::numbers::pi / 180, 1e-12);
  step(Action::forward);
  // 10 degrees to the right of -z: x grows by 0.15 sin 10.
  EXPECT_NEAR(state_.pose(task_).position.x, 0.15 * std::sin(10 * std::numbers::pi / 180), kTolerance_m);
  EXPECT_NEAR(state_.pose(task_).position.z, -0.15 * std::cos(10 * std::numbers::pi / 180), kTolerance_m);
}

TEST_F(AvNavTask, AFullCircleGivesTheSameBits) {
  state_.begin(task_, field_, start_, 1.2345, 12);
  const double heading_rad = state_.pose(task_).heading_rad;
  step_times(36, Action::left);
  EXPECT_EQ(state_.pose(task_).heading_rad, heading_rad);
  step_times(7, Action::right);
  step_times(7, Action::left);
  EXPECT_EQ(state_.pose(task_).heading_rad, heading_rad);
  step_times(36, Action::right);
  EXPECT_EQ(state_.pose(task_).heading_rad, heading_rad);
}

TEST_F(AvNavTask, ThirtySixThousandTurnsDoNotDrift) {
  task_.max_steps = 100'000;
  state_.begin(task_, field_, start_, 0.5, 12);
  step_times(36'000 + 9, Action::right);
  EXPECT_NEAR(std::remainder(state_.pose(task_).heading_rad - (0.5 - std::numbers::pi / 2), 2 * std::numbers::pi), 0.0, 1e-12);
}

TEST_F(AvNavTask, StraightSuccessByHand) {
  // 14 x 0.15 = 2.1 m of 3 m: 0.9 m to go, inside 1 m.
  EXPECT_NEAR(step_times(14, Action::forward), 14 * -0.01 + 2.1, kTolerance_m);
  EXPECT_NEAR(step(Action::stop), -0.01 + 10, kTolerance_m);
  EXPECT_TRUE(state_.terminated());
  EXPECT_FALSE(state_.truncated());
  const EpisodeMetrics m = state_.metrics(task_);
  EXPECT_EQ(m.success, 1);
  EXPECT_NEAR(m.spl, 1.0, 1e-6);           // p = 2.1 < l = 3: l / max(p, l) = 1
  EXPECT_NEAR(m.soft_spl, 0.7, 1e-3);      // 1 - 0.9 / 3
  EXPECT_NEAR(m.sna, 12.0 / 15.0, 1e-12);  // 15 actions, the oracle needs 12
  EXPECT_NEAR(m.dtg_m, 0.9, kTolerance_m);
  EXPECT_NEAR(m.reward, 15 * -0.01 + 2.1 + 10, kTolerance_m);
  EXPECT_EQ(m.steps, 15);
  EXPECT_EQ(m.collisions, 0);
}

// Fewer actions than the oracle's, which walks on to half a metre: counted as many as it took.
TEST_F(AvNavTask, SnaIsAtMostOne) {
  state_.begin(task_, field_, start_, 0.0, 20);
  step_times(14, Action::forward);
  step(Action::stop);
  EXPECT_EQ(state_.metrics(task_).success, 1);
  EXPECT_EQ(state_.metrics(task_).sna, 1);
}

// 13 x 0.15 = 1.95: 1.05 m to go, outside 1 m by a third of a step.  The reward for success is paid where success is counted, and only
// there.
TEST_F(AvNavTask, StoppingJustOutsidePaysNothing) {
  for (const float radius_m : {1.f, 1.04f, 1.06f, 2.f}) {
    task_.success_radius_m = radius_m;
    state_.begin(task_, field_, start_, 0.0, 12);
    step_times(13, Action::forward);
    const bool inside = radius_m > 1.05f;
    EXPECT_NEAR(step(Action::stop), -0.01 + (inside ? 10 : 0), kTolerance_m) << radius_m;
    EXPECT_EQ(state_.metrics(task_).success, inside ? 1 : 0) << radius_m;
  }
}

TEST_F(AvNavTask, DetourLowersSplByHand) {
  step_times(18, Action::left);
  EXPECT_NEAR(step_times(10, Action::forward), -0.1 - 1.5, kTolerance_m);  // away: 4.5 m to go
  EXPECT_NEAR(state_.distance_to_goal_m(), 4.5, kTolerance_m);
  step_times(18, Action::left);
  step_times(24, Action::forward);
  step(Action::stop);
  const EpisodeMetrics m = state_.metrics(task_);
  EXPECT_NEAR(m.spl, 3.0 / 5.1, 1e-4);  // p = 1.5 + 3.6
  EXPECT_NEAR(m.soft_spl, 0.7 * 3.0 / 5.1, 1e-4);
  EXPECT_NEAR(m.sna, 12.0 / 71.0, 1e-12);
}

TEST_F(AvNavTask, StoppingFarAwayTerminatesWithoutSuccess) {
  EXPECT_FLOAT_EQ(step(Action::stop), -0.01f);
  EXPECT_TRUE(state_.terminated());
  const EpisodeMetrics m = state_.metrics(task_);
  EXPECT_EQ(m.success, 0);
  EXPECT_EQ(m.spl, 0);
  EXPECT_EQ(m.sna, 0);
  EXPECT_NEAR(m.soft_spl, 0, 1e-6);
  EXPECT_NEAR(m.dtg_m, 3, kTolerance_m);
}

TEST_F(AvNavTask, MovingAwayGivesNoNegativeSoftSpl) {
  step_times(18, Action::left);
  step_times(10, Action::forward);
  step(Action::stop);
  EXPECT_EQ(state_.metrics(task_).soft_spl, 0);
}

TEST_F(AvNavTask, RunningOutOfStepsTruncatesEvenInsideTheGoal) {
  task_.max_steps = 15;
  state_.begin(task_, field_, start_, 0.0, 12);
  step_times(14, Action::forward);
  EXPECT_FALSE(state_.truncated());
  EXPECT_NEAR(step(Action::forward), 0.14, kTolerance_m);
  EXPECT_TRUE(state_.truncated());
  EXPECT_FALSE(state_.terminated());
  EXPECT_EQ(state_.metrics(task_).success, 0);
  EXPECT_EQ(state_.metrics(task_).spl, 0);
}

TEST_F(AvNavTask, StoppingOnTheLastStepIsATermination) {
  task_.max_steps = 15;
  state_.begin(task_, field_, start_, 0.0, 12);
  step_times(14, Action::forward);
  step(Action::stop);
  EXPECT_TRUE(state_.terminated());
  EXPECT_FALSE(state_.truncated());
  EXPECT_EQ(state_.metrics(task_).success, 1);
}

TEST_F(AvNavTask, WallsAreReportedAndCounted) {
  // The floor ends at z = -7; the agent's centre can come within 0.1 m of it.  46 x 0.15 = 6.9.
  step_times(45, Action::forward);
  EXPECT_EQ(state_.metrics(task_).collisions, 0);
  step_times(3, Action::forward);
  EXPECT_TRUE(state_.collided());
  EXPECT_GE(state_.metrics(task_).collisions, 2);
  step(Action::left);
  EXPECT_FALSE(state_.collided());
}

TEST_F(AvNavTask, AnUnknownDistanceKeepsTheLastAndStaysFinite) {
  // The field belongs to a floor of 2 m: 2 m beyond its edge it knows no distance, while the agent walks on its own larger floor.
  const Navmesh small(floor_mesh(2), NavmeshConfig{});
  const GeodesicField field(small, {0, 0, 0.5f});
  state_.begin(task_, field, start_, 0.0, 5);
  double reward = 0;
  for (int i = 0; i < 40; ++i) {
    const float r = state_.step(task_, navmesh_, field, Action::forward);
    ASSERT_TRUE(std::isfinite(r));
    reward += static_cast<double>(r);
  }
  EXPECT_GT(state_.lost_distances(), 5);
  // Rewards telescope: what was paid is the difference of the first and the last known distance.
  EXPECT_NEAR(reward, -0.4 + 0.5 - static_cast<double>(state_.distance_to_goal_m()), 1e-3);
  const EpisodeMetrics m = state_.metrics(task_);
  for (const double value : {m.success, m.spl, m.soft_spl, m.sna, m.dtg_m, m.reward}) EXPECT_TRUE(std::isfinite(value));
}

TEST_F(AvNavTask, AStartWithoutAPathIsRefused) {
  TriangleMesh mesh = floor_mesh(6);
  const TriangleMesh other = floor_mesh(4, 20);
  for (const auto& v : other.vertices) mesh.vertices.push_back(v);
  for (const auto& t : other.triangles) mesh.triangles.push_back(t + glm::uvec3(4));
  mesh.triangle_material = mesh.triangle_object = {0, 0, 0, 0};
  const Navmesh islands(mesh, NavmeshConfig{});
  const GeodesicField field(islands, {20, 0, 0});
  EXPECT_THROW(state_.begin(task_, field, *islands.snap({0, 0, 0}), 0.0, 5), InputError);
  EXPECT_FALSE(count_oracle_actions(task_, islands, field, *islands.snap({0, 0, 0}), 0.0));
}

TEST_F(AvNavTask, StartingOnTheGoalDividesByNothing) {
  const GeodesicField field(navmesh_, start_);
  state_.begin(task_, field, start_, 0.0, 1);
  state_.step(task_, navmesh_, field, Action::stop);
  const EpisodeMetrics m = state_.metrics(task_);
  EXPECT_EQ(m.success, 1);
  EXPECT_NEAR(m.spl, 1, 1e-6);
  EXPECT_NEAR(m.soft_spl, 1, 1e-3);
  EXPECT_EQ(m.sna, 1);
}

TEST_F(AvNavTask, OracleCountsByHand) {
  // Walks until less than 0.5 m are left: 17 x 0.15 = 2.55, and the stop.
  EXPECT_EQ(count_oracle_actions(task_, navmesh_, field_, start_, 0.0), 18);
  EXPECT_EQ(count_oracle_actions(task_, navmesh_, field_, start_, -std::numbers::pi / 2), 9 + 18);
  EXPECT_EQ(count_oracle_actions(task_, navmesh_, field_, start_, std::numbers::pi / 2), 9 + 18);
  // 4 degrees off: 0.209 m to the side.  After 12 steps the goal is 1.19 m ahead and 9.95 degrees off, so it turns once (9 is the limit),
  // and 1.21 m to go are 5 more steps.
  EXPECT_EQ(count_oracle_actions(task_, navmesh_, field_, start_, 4 * std::numbers::pi / 180), 12 + 1 + 5 + 1);
}

TEST_F(AvNavTask, OracleTurnsTheShortWay) {
  const Pose to_the_left{start_, -30 * std::numbers::pi / 180}, to_the_right{start_, 30 * std::numbers::pi / 180};
  EXPECT_EQ(oracle_action(task_, field_, to_the_left), Action::left);
  EXPECT_EQ(oracle_action(task_, field_, to_the_right), Action::right);
  EXPECT_EQ(oracle_action(task_, field_, {start_, 350 * std::numbers::pi / 180}), Action::left);
  EXPECT_EQ(oracle_action(task_, field_, {start_, 0.0}), Action::forward);
  EXPECT_EQ(oracle_action(task_, field_, {field_.goal(), 0.0}), Action::stop);
}

TEST(TaskConfig, ReadsItsKeysAndRefusesOthers) {
  TaskConfig task;
  auto reader = ConfigReader::from_text("{forward_m: 0.25, turn_deg: 15, step_time_s: 0.25, max_steps: 300, success_radius_m: 0.36}", "t");
  read(reader, task);
  reader.finish();
  validate(task);
  EXPECT_EQ(task.forward_m, 0.25f);
  EXPECT_EQ(turns_per_circle(task), 24);
  EXPECT_EQ(task.max_steps, 300);
  auto wrong = ConfigReader::from_text("{foward_m: 1}", "t");
  read(wrong, task);
  EXPECT_THROW(wrong.finish(), InputError);
}

TEST(TaskConfig, ValuesOutOfRangeAreRefused) {
  const auto refused = [](auto change) {
    TaskConfig task;
    change(task);
    EXPECT_THROW(validate(task), InputError);
  };
  refused([](TaskConfig& t) { t.turn_deg = 7; });  // does not divide 360
  refused([](TaskConfig& t) { t.turn_deg = 0; });
  refused([](TaskConfig& t) { t.turn_deg = std::numeric_limits<float>::quiet_NaN(); });
  refused([](TaskConfig& t) { t.forward_m = -1; });
  refused([](TaskConfig& t) { t.max_steps = 0; });
  refused([](TaskConfig& t) { t.step_reward = std::numeric_limits<float>::infinity(); });
  refused([](TaskConfig& t) { t.success_radius_m = 0; });
  refused([](TaskConfig& t) { t.step_time_s = 0; });
  TaskConfig exact;
  exact.turn_deg = 22.5f;
  EXPECT_NO_THROW(validate(exact));
}

}  // namespace
}  // namespace earshot
