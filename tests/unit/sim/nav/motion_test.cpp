// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/nav/geodesic_field.h"
#include "sim/scene/generators/house_generator.h"
#include "tests/support/envs/nav_scenes.h"

namespace earshot {
namespace {

constexpr float kStepM = 0.15f;

glm::vec3 heading(float degrees, float length_m) {
  const float angle = degrees * std::numbers::pi_v<float> / 180.f;
  return {length_m * std::sin(angle), 0, length_m * std::cos(angle)};
}

TEST(Slide, OpenFloorMovesAsAsked) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  for (int degrees = 0; degrees < 360; degrees += 10) {
    const glm::vec3 from{3, 0, 2}, step = heading(static_cast<float>(degrees), kStepM);
    const MoveResult move = slide(nav, from, step);
    EXPECT_FALSE(move.collided);
    EXPECT_NEAR(flat_distance(move.position, from + step), 0.f, 1e-6f);  // float rounding at 3 m
    EXPECT_NEAR(move.position.y, 0.f, 1e-5f);
  }
}

TEST(Slide, StandingStillIsNoCollision) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  const MoveResult move = slide(nav, {3, 0, 2}, {0, 0, 0});
  EXPECT_FALSE(move.collided);
  EXPECT_EQ(move.position, glm::vec3(3, 0, 2));
}

// H-64: after the first blocked step the pose does not change by a bit, straight into a wall and in a corner.
TEST(Slide, PushingOnLeavesThePoseBitEqual) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  for (const float degrees : {0.f, 90.f, 180.f, 270.f, 30.f, 45.f, 77.f, 200.f, 351.f}) {
    glm::vec3 position{3, 0, 2};
    for (int step = 0; step < 200; ++step) position = slide(nav, position, heading(degrees, kStepM)).position;
    for (int step = 0; step < 500; ++step) {
      const MoveResult move = slide(nav, position, heading(degrees, kStepM));
      ASSERT_EQ(move.position, position) << degrees;
      ASSERT_TRUE(move.collided);
    }
  }
}

TEST(Slide, StraightIntoAWallStopsAtItInOneStep) {
  const Navmesh nav(floor_with(6, 4, {}), {});
  const float border = nav.snap({3, 0, 4.2f}, 1.f)->z;
  const MoveResult hit = slide(nav, {3, 0, border - 0.05f}, {0, 0, kStepM});
  EXPECT_TRUE(hit.collided);
  EXPECT_NEAR(hit.position.z, border, 2e-4f);  // agents stop 0.1 mm off
  EXPECT_NEAR(hit.position.x, 3.f, 1e-5f);
  EXPECT_EQ(slide(nav, hit.position, {0, 0, kStepM}).position, hit.position);
}

// H-65: along a wall the tangential part of the move remains: cos(angle) of it, and the rest is the truthful collision.
TEST(Slide, GrazingAWallKeepsTheTangentialPart) {
  const Navmesh nav(floor_with(12, 4, {}), {});
  const float border = nav.snap({3, 0, 4.2f}, 1.f)->z;
  for (const float into_wall_deg : {1.f, 3.f, 10.f, 30.f, 60.f, 80.f}) {
    const glm::vec3 from{3, 0, border};
    const glm::vec3 step = heading(90.f - into_wall_deg, kStepM);  // mostly +x, partly +z into the wall
    const MoveResult move = slide(nav, from, step);
    const float expected = kStepM * std::cos(into_wall_deg * std::numbers::pi_v<float> / 180.f);
    EXPECT_NEAR(move.position.x - 3.f, expected, 2e-4f) << into_wall_deg;
    EXPECT_NEAR(move.position.z, border, 2e-4f);
    EXPECT_EQ(move.collided, expected < kStepM - 1e-3f) << into_wall_deg;
  }
}

TEST(Slide, AWallAsThinAsASheetIsNotTunnelled) {
  // A sheet of 1 mm across most of the room: the way round it is much longer than a step.
  const Navmesh nav(floor_with(6, 4, {{3, -0.1f, 3.001f, 3}}), {});
  for (const float length_m : {0.01f, 0.05f, 0.1f, 0.15f, 0.25f})
    for (int degrees = 1; degrees < 180; degrees += 7) {
      glm::vec3 position{2.5f, 0, 1};
      for (int step = 0; step < 40 && position.z < 2.8f && position.z > 0.3f; ++step) {
        position = slide(nav, position, heading(static_cast<float>(degrees), length_m)).position;
        ASSERT_LT(position.x, 3.f) << degrees << " " << length_m;
      }
    }
}

// Random walks through a furnished house: no step is longer than its displacement, none is reached by a detour, the flag is true to what
// was covered, and the agent stays on the surface.
TEST(Slide, RandomWalksStayOnTheSurfaceAndTellTheTruth) {
  const Navmesh nav(generate_house({.seed = 5, .rooms = 3, .area_m2 = 40}), {});
  const RandomStream random(11, Purpose::test);
  int collisions = 0;
  for (std::uint32_t walk = 0; walk < 40; ++walk) {
    glm::vec3 position = nav.random_point(random, 2 * walk);
    for (std::uint32_t step = 0; step < 100; ++step) {
      const auto u = random.uniform2(1000 + 100 * walk + step / 8);
      const float length_m = step % 3 == 0 ? 0.25f : kStepM;
      const glm::vec3 displacement = heading(360.f * u[0], length_m);
      const MoveResult move = slide(nav, position, displacement);
      const float covered_m = flat_distance(move.position, position);
      ASSERT_LE(covered_m, length_m + 1e-5f);
      ASSERT_EQ(move.collided, covered_m < length_m - 1e-3f);
      const auto on_surface = nav.snap(move.position, 0.01f);
      ASSERT_TRUE(on_surface);
      ASSERT_NEAR(flat_distance(*on_surface, move.position), 0.f, 1e-5f);
      // What was walked is a path, so the shortest is at most as long; through a wall or across a corner it would be.
      const auto path_m = nav.path_length_m(position, move.position);
      ASSERT_TRUE(path_m);
      ASSERT_LE(*path_m, length_m + 0.003f);  // corners of paths stand off by 1 mm
      collisions += move.collided;
      position = move.position;
    }
  }
  EXPECT_GT(collisions, 500);  // the walls were met
}

TEST(Slide, ClimbsRamps) {
  TriangleMesh mesh = floor_with(3, 4, {});
  append_floor(mesh, 6, 0, 9, 4, 1.f);
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), {{3, 0, 0}, {3, 0, 4}, {6, 1, 4}, {6, 1, 0}});
  for (const glm::uvec3 t : {glm::uvec3{0, 1, 2}, glm::uvec3{0, 2, 3}}) {
    mesh.triangles.push_back(t + glm::uvec3(first));
    mesh.triangle_material.push_back(0);
    mesh.triangle_object.push_back(0);
  }
  const Navmesh nav(mesh, {});
  glm::vec3 position{1, 0, 2};
  for (int step = 0; step < 40; ++step) {
    position = slide(nav, position, {kStepM, 0, 0}).position;
    const float expected_y = std::clamp((position.x - 3) / 3, 0.f, 1.f);
    EXPECT_NEAR(position.y, expected_y, 0.06f);  // the detail mesh follows to a cell's height
  }
  EXPECT_NEAR(position.x, 7.f, 0.01f);
  EXPECT_NEAR(position.y, 1.f, 1e-3f);
  // Along the surface 2 m flat, sqrt(3^2 + 1) of ramp, 1 m flat; a polygon may span the bend, and then counts as flat: the chord at least.
  const auto length_m = nav.path_length_m({1, 0, 2}, {7, 1, 2});
  ASSERT_TRUE(length_m);
  EXPECT_GE(*length_m, std::sqrt(37.f) - 1e-3f);
  EXPECT_LE(*length_m, 3 + std::sqrt(10.f) + 1e-3f);
}

}  // namespace
}  // namespace earshot
