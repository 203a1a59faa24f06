// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/topdown_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/scene/scene.h"

namespace earshot {
namespace {

constexpr float kHalfM = 7;
/// The agent's radius, and what voxels and the straightening of borders may move a border by.
constexpr float kRadiusM = 0.1f, kBorderM = 0.15f;

/// A flat floor of 14 x 14 m around the origin.
TriangleMesh floor_mesh() {
  TriangleMesh mesh;
  mesh.vertices = {{-kHalfM, 0, -kHalfM}, {kHalfM, 0, -kHalfM}, {kHalfM, 0, kHalfM}, {-kHalfM, 0, kHalfM}};
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}};
  mesh.triangle_material = mesh.triangle_object = {0, 0};
  mesh.material_names = mesh.object_names = {"floor"};
  return mesh;
}

struct Picture {
  TopdownMapConfig config;
  std::vector<std::uint8_t> image;
  [[nodiscard]] int at(int row, int column, int channel) const {
    return image[static_cast<std::size_t>((row * config.size_px + column) * map_channels(config) + channel)];
  }
  [[nodiscard]] int count(int channel) const {
    int sum = 0;
    for (int row = 0; row < config.size_px; ++row)
      for (int column = 0; column < config.size_px; ++column) sum += at(row, column, channel) == 255 ? 1 : 0;
    return sum;
  }
};

class TopdownMap : public testing::Test {
 protected:
  Picture draw(const TopdownMapConfig& config, const MapMarks& marks) const {
    Picture picture{config, std::vector<std::uint8_t>(static_cast<std::size_t>(config.size_px * config.size_px * map_channels(config)),
                                                      std::uint8_t{77})};
    draw_topdown_map(config, map_, marks, picture.image);
    return picture;
  }
  Navmesh navmesh_{floor_mesh(), NavmeshConfig{}};
  WalkableMap map_{navmesh_};
  float floor_m_ = navmesh_.snap({0, 0, 0})->y;
};

// Every pixel but those on the border, whatever the agent's place and heading.
TEST_F(TopdownMap, PixelsShowTheFloorFromWhereTheAgentStands) {
  for (const MapFrame frame : {MapFrame::egocentric, MapFrame::allocentric})
    for (const double heading : {0.0, 0.7, std::numbers::pi / 2, -2.5}) {
      const TopdownMapConfig config{.size_px = 64, .metres_per_px = 0.25f, .frame = frame};
      const MapMarks marks{.position = {3, floor_m_, 1}, .heading_rad = heading};
      const Picture picture = draw(config, marks);
      const bool is_egocentric = frame == MapFrame::egocentric;
      const double h = is_egocentric ? heading : 0;
      const glm::dvec2 middle = is_egocentric ? glm::dvec2(3, 1) : glm::dvec2(0, 0);
      int shown = 0;
      for (int row = 0; row < 64; ++row)
        for (int column = 0; column < 64; ++column) {
          const double right = (column + 0.5 - 32) * 0.25, ahead = (32 - row - 0.5) * 0.25;
          const double x = middle.x + right * std::cos(h) - ahead * std::sin(h), z = middle.y - right * std::sin(h) - ahead * std::cos(h);
          const double inside = static_cast<double>(kHalfM - kRadiusM) - std::max(std::fabs(x), std::fabs(z));
          if (std::fabs(inside) < static_cast<double>(kBorderM)) continue;
          ASSERT_EQ(picture.at(row, column, 0), inside > 0 ? 255 : 0) << row << " " << column << " " << heading;
          shown += inside > 0 ? 1 : 0;
        }
      EXPECT_GT(shown, 1000);
    }
}

TEST_F(TopdownMap, TheAgentPointsUpInItsOwnMapAndAlongItsHeadingInTheSceneS) {
  const TopdownMapConfig egocentric{.size_px = 33, .metres_per_px = 0.25f},
      fixed{.size_px = 33, .metres_per_px = 0.25f, .frame = MapFrame::allocentric};
  for (const double heading : {0.0, 1.0, 2.0, -3.0}) {
    const Picture picture = draw(egocentric, {.position = {2, floor_m_, -1}, .heading_rad = heading});
    EXPECT_EQ(picture.at(16, 16, 2), 255);
    EXPECT_EQ(picture.at(14, 16, 2), 255);  // half a metre ahead
    EXPECT_EQ(picture.at(19, 16, 2), 0);
  }
  // forward_of(pi / 2) is -x: to the left in a map with -z upwards.
  const Picture west = draw(fixed, {.position = {0, floor_m_, 0}, .heading_rad = std::numbers::pi / 2});
  EXPECT_EQ(west.at(16, 14, 2), 255);
  EXPECT_EQ(west.at(16, 19, 2), 0);
  EXPECT_EQ(west.at(13, 16, 2), 0);
}

TEST_F(TopdownMap, ThePathIsDrawnAsFarAsItIsOnThisStorey) {
  const TopdownMapConfig config{.size_px = 64, .metres_per_px = 0.25f};
  const std::vector<glm::vec3> path{{0, floor_m_, 0}, {0, floor_m_, -1}, {0, floor_m_, -3}};
  const Picture picture = draw(config, {.position = {0, floor_m_, -3}, .path = path});
  for (int row = 32; row <= 43; ++row) EXPECT_EQ(picture.at(row, 32, 1), 255) << row;  // 3 m behind the agent: twelve pixels
  EXPECT_LE(picture.count(1), 14);
  const std::vector<glm::vec3> upstairs{{0, floor_m_ + 3, 0}, {0, floor_m_ + 3, -3}};
  EXPECT_EQ(draw(config, {.position = {0, floor_m_, -3}, .path = upstairs}).count(1), 0);
  EXPECT_EQ(draw(config, {.position = {0, floor_m_ + 3, 0}}).count(0), 0);  // there is no floor up there
  const std::vector<glm::vec3> far{{1e6f, floor_m_, 0}, {1e6f, floor_m_, -3}, {-1e6f, floor_m_, 5}};
  const Picture crossed = draw(config, {.position = {0, floor_m_, 0}, .path = far, .goals = far});
  EXPECT_GE(crossed.count(0), 1000);
}

TEST_F(TopdownMap, GoalsAreDrawnOnlyWhereTheyAreAskedFor) {
  TopdownMapConfig config{.size_px = 64, .metres_per_px = 0.25f};
  const std::vector<glm::vec3> goals{{0, floor_m_, -4}, {2, floor_m_ + 3, 0}};
  const MapMarks marks{.position = {0, floor_m_, 0}, .goals = goals};
  const Picture without = draw(config, marks);
  EXPECT_EQ(without.image.size(), 64u * 64u * 3u);
  config.goal = true;
  const Picture with = draw(config, marks);
  EXPECT_EQ(with.image.size(), 64u * 64u * 4u);
  EXPECT_EQ(with.at(16, 32, 3), 255);  // 4 m ahead
  EXPECT_LE(with.count(3), 9);         // the other one is on another storey
  for (int channel = 0; channel < 3; ++channel) EXPECT_EQ(with.count(channel), without.count(channel));
}

// Where agents walk is walkable on the map, to a cell, but in corners that are narrower than a cell for more than its length: one point in
// two hundred at most.  A metre up nothing is.
TEST(WalkableMap, HoldsTheSurfaceOfAHouse) {
  const Scene scene = load_scene("house:3");
  const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
  const WalkableMap map(navmesh);
  const RandomStream random(1, Purpose::test);
  int missed = 0;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    const glm::vec3 point = navmesh.random_point(random, 2 * i);
    bool near = false;
    for (const float dx : {-1.f, 0.f, 1.f})
      for (const float dz : {-1.f, 0.f, 1.f})
        near = near || map.walkable(point.x + dx * map.cell_m(), point.z + dz * map.cell_m(), point.y);
    missed += near ? 0 : 1;
    EXPECT_FALSE(map.walkable(point.x, point.z, point.y + 1.f));
  }
  EXPECT_LE(missed, 10);
  double cells = 0;
  for (float z = map.low().y + map.cell_m() / 2; z < map.high().y; z += map.cell_m())
    for (float x = map.low().x + map.cell_m() / 2; x < map.high().x; x += map.cell_m())
      cells += map.walkable(x, z, navmesh.random_point(random, 0).y) ? 1 : 0;
  // Cells count by their middle: the sum is off by less than half a cell along the border, a few percent of a furnished house.
  EXPECT_NEAR(cells * static_cast<double>(map.cell_m() * map.cell_m()), static_cast<double>(navmesh.main_area_m2()),
              0.03 * static_cast<double>(navmesh.main_area_m2()));
  for (const float beyond : {-1e30f, 1e30f, NAN}) EXPECT_FALSE(map.walkable(beyond, 0, 0));
  EXPECT_LT(map.bytes(), 10'000'000u);
}

TEST(TopdownMapConfig, RangesAreChecked) {
  EXPECT_NO_THROW(validate(TopdownMapConfig{}));
  EXPECT_THROW(validate(TopdownMapConfig{.size_px = 7}), InputError);
  EXPECT_THROW(validate(TopdownMapConfig{.size_px = 1025}), InputError);
  EXPECT_THROW(validate(TopdownMapConfig{.metres_per_px = 0.01f}), InputError);
  EXPECT_THROW(validate(TopdownMapConfig{.metres_per_px = NAN}), InputError);
}

}  // namespace
}  // namespace earshot
