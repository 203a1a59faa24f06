// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/field_grid.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <utility>
#include <vector>

#include "sim/acoustics/core/sampling.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using rooms::divided_box;

double volume_m3(const FieldGrid& grid) {
  double sum = 0;
  for (std::uint32_t cell = 0; cell < grid.size(); ++cell) sum += double{grid.volume_m3(cell)};
  return sum;
}

TEST(FieldGrid, CellsFillTheRoomOnce) {
  const auto room = rooms::shoe1(0.2, 1);
  const FieldGrid grid(*room, 0.7f);
  EXPECT_EQ(grid.size(), 7u * 6u * 4u);  // round(5 / 0.7), round(4 / 0.7), round(3 / 0.7)
  EXPECT_NEAR(volume_m3(grid), 60.0, 1e-3);
}

TEST(FieldGrid, AWallSplitsItsBoxesAndTheirVolume) {
  const auto room = divided_box(0);
  const FieldGrid grid(*room, 1.f);
  // Boxes of 1 m: the wall at 2.2 m cuts the third of five layers, 4 x 3 boxes.
  EXPECT_EQ(grid.size(), 60u + 12u);
  EXPECT_NEAR(volume_m3(grid), 60.0, 1e-3);
  // Of each of them a fifth lies on the near side: 512 jittered points know that within 0.02 of the box.
  double near_m3 = 0;
  for (std::uint32_t cell = 0; cell < grid.size(); ++cell)
    if (grid.volume_m3(cell) < 0.5f) near_m3 += double{grid.volume_m3(cell)};
  EXPECT_NEAR(near_m3 / 12, 0.2, 0.02);
}

/// A room of 6 x 5 x 3 m and a closed cabinet at a drawn place.  turned: all triangles run the other way round.
TriangleMesh room_with_cabinet(std::uint32_t draw, bool turned, glm::vec3& in_cabinet) {
  const auto u = RandomStream(5, Purpose::test, draw).uniform4(0), v = RandomStream(5, Purpose::test, draw).uniform4(1);
  const glm::vec3 size(1.1f + 0.5f * u[0], 1.5f + 0.7f * u[1], 0.8f + 0.4f * u[2]);
  const glm::vec3 lower(3.f + 1.2f * u[3], 0.1f, -2.f - 2.8f * v[0]);
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 5, 3}, 0);
  append_box(mesh, lower, lower + size, 0, 0);
  if (turned)
    for (glm::uvec3& triangle : mesh.triangles) std::swap(triangle.y, triangle.z);
  in_cabinet = lower + 0.5f * size;
  return mesh;
}

std::uint32_t room_at(const FieldGrid& grid, glm::vec3 point) {
  std::array<FieldGrid::CellWeight, 8> cells{};
  return grid.blend(point, cells) > 0 ? grid.room(cells[0].cell) : FieldGrid::no_room;
}

TEST(FieldGrid, InsidesOfBodiesAreToldFromRooms) {
  const std::vector<Material> walls{Material::uniform("wall", 0.2f, 1.f)};
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    glm::vec3 in_cabinet;
    const auto room = rooms::scene_of(room_with_cabinet(draw, draw % 2 == 1, in_cabinet), walls);
    const FieldGrid grid(*room, 1.f);
    ASSERT_EQ(grid.num_rooms(), 2u) << draw;
    EXPECT_TRUE(grid.inside_body(room_at(grid, in_cabinet))) << draw;
    EXPECT_FALSE(grid.inside_body(room_at(grid, rooms::point(1, 1, 1.5)))) << draw;
  }
}

TEST(FieldGrid, RoomsAreNoBodiesWhicheverWayTheirWallsTurn) {
  const std::vector<Material> walls{Material::uniform("wall", 0.2f, 1.f)};
  for (std::uint32_t draw = 0; draw < 12; ++draw) {
    const auto u = RandomStream(6, Purpose::test, draw).uniform4(0);
    const double x_m = 1.5 + 2.5 * double{u[0]};
    TriangleMesh divided;  // a partition turns one side to each of two rooms
    rooms::append_box(divided, {0, 0, 0}, {6, 5, 3}, 0);
    rooms::append_quad(divided, {rooms::point(x_m, 0, 0), rooms::point(x_m, 5, 0), rooms::point(x_m, 5, 3), rooms::point(x_m, 0, 3)}, 0);
    TriangleMesh apart;  // of two rooms apart the second, larger or smaller, turns its walls outward
    rooms::append_box(apart, {0, 0, 0}, {x_m, 4, 3}, 0);
    append_box(apart, rooms::point(5, 4, 0), rooms::point(8, 0, 3), 0, 0);
    TriangleMesh mixed;  // every other triangle is turned
    rooms::append_box(mixed, {0, 0, 0}, {6, 5, 3}, 0);
    append_box(mixed, rooms::point(3, 3, 0.1), rooms::point(4.2, 2, 2), 0, 0);
    for (std::size_t i = 0; i < mixed.triangles.size(); i += 2) std::swap(mixed.triangles[i].y, mixed.triangles[i].z);
    for (TriangleMesh* mesh : {&divided, &apart, &mixed}) {
      const auto scene = rooms::scene_of(std::move(*mesh), walls);
      const FieldGrid grid(*scene, 1.f);
      ASSERT_GE(grid.num_rooms(), 2u) << draw;
      for (std::uint32_t room = 0; room < grid.num_rooms(); ++room) EXPECT_FALSE(grid.inside_body(room)) << draw << ", room " << room;
    }
  }
}

TEST(FieldGrid, CrossingsCoverASegmentWithoutGapOrOverlap) {
  const auto room = divided_box(1);
  const FieldGrid grid(*room, 0.6f);
  for (std::uint32_t i = 0; i < 500; ++i) {
    const auto u = RandomStream(1, Purpose::test, i).uniform4(0), v = RandomStream(1, Purpose::test, i).uniform4(1);
    const glm::vec3 from = rooms::point(5.0 * u[0], 4.0 * u[1], 3.0 * u[2]);
    const glm::vec3 direction = sphere_direction(v[0], v[1]);
    const Hit hit = room->rays().intersect(from, direction);
    ASSERT_TRUE(hit.valid());
    std::vector<FieldGrid::Crossing> crossings;
    grid.cross(from, direction, hit.distance_m, crossings);
    float end_m = 0;
    for (const FieldGrid::Crossing& crossing : crossings) {
      ASSERT_LT(crossing.cell, grid.size());
      EXPECT_NEAR(crossing.enter_m, end_m, 1e-4f) << i;
      EXPECT_GT(crossing.leave_m, crossing.enter_m);
      end_m = crossing.leave_m;
    }
    EXPECT_NEAR(end_m, hit.distance_m, 1e-4f) << i;
  }
}

TEST(FieldGrid, BothSidesOfAClosedWallShareNoCell) {
  const auto room = divided_box(0);
  const FieldGrid grid(*room, 1.f);
  std::vector<int> side(grid.size(), 0);  // bit 0: seen from the near side, bit 1: from the far side
  for (std::uint32_t i = 0; i < 2000; ++i) {
    const auto u = RandomStream(2, Purpose::test, i).uniform4(0), v = RandomStream(2, Purpose::test, i).uniform4(1);
    const double x = 5.0 * u[0];
    if (std::abs(x - 2.2) < 1e-3) continue;
    const int bit = x < 2.2 ? 1 : 2;
    const glm::vec3 from = rooms::point(x, 4.0 * u[1], 3.0 * u[2]);
    std::array<FieldGrid::CellWeight, 8> fractions;
    const std::size_t count = grid.blend(from, fractions);
    float sum = 0;
    for (std::size_t k = 0; k < count; ++k) {
      side[fractions[k].cell] |= bit;
      sum += fractions[k].weight;
    }
    EXPECT_NEAR(sum, 1.f, 1e-5f);
    const glm::vec3 direction = sphere_direction(v[0], v[1]);
    std::vector<FieldGrid::Crossing> crossings;
    grid.cross(from, direction, room->rays().intersect(from, direction).distance_m, crossings);
    for (const FieldGrid::Crossing& crossing : crossings) side[crossing.cell] |= bit;
  }
  for (std::size_t cell = 0; cell < side.size(); ++cell) EXPECT_NE(side[cell], 3) << cell;
}

/// A path that bounces in one half of a box divided by a closed wall, each segment told where the one before it ended.
TEST(FieldGrid, TheCellWhereASegmentBeginsTellsWhatRaysTell) {
  const auto room = divided_box(0);
  const FieldGrid grid(*room, 1.f);
  double told_m = 0, equal_m = 0, by_rays_m = 0;
  for (const double x : {1.0, 3.5}) {
    glm::vec3 origin = rooms::point(x, 2.1, 1.6), direction = sphere_direction(0.3f, 0.7f);
    std::uint32_t cell = FieldGrid::no_cell;
    for (std::uint32_t i = 0; i < 3000; ++i) {
      const Hit hit = room->rays().intersect(origin, direction);
      ASSERT_TRUE(hit.valid());
      std::vector<FieldGrid::Crossing> told, by_rays;
      cell = grid.cross(origin, direction, hit.distance_m, told, cell);
      grid.cross(origin, direction, hit.distance_m, by_rays);
      for (const FieldGrid::Crossing& crossing : by_rays) by_rays_m += double{crossing.leave_m - crossing.enter_m};
      for (const FieldGrid::Crossing& crossing : told) {
        const double length_m = double{crossing.leave_m - crossing.enter_m};
        told_m += length_m;
        EXPECT_EQ(grid.inside(crossing.cell).x < 2.2f, x < 2.2) << i;
        for (const FieldGrid::Crossing& other : by_rays)
          if (other.enter_m == crossing.enter_m && other.cell == crossing.cell) equal_m += length_m;
      }
      origin = offset_from_surface(hit.position, hit.normal);
      const auto u = RandomStream(3, Purpose::test, i).uniform2(0);
      direction = lambert_direction(hit.normal, u[0], u[1]);
    }
  }
  // All of the air belongs to some cell, and walls that are straight leave no doubt where rays do not err themselves.
  EXPECT_GT(told_m, 0.9999 * by_rays_m);
  EXPECT_GT(equal_m, 0.999 * told_m);
}

TEST(FieldGrid, AirBetweenTwoSheetsIsAGapOfNoCell) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {5, 4, 3}, 0);
  for (const double x : {2.2, 2.21})
    rooms::append_quad(mesh, {rooms::point(x, 0, 0), rooms::point(x, 4, 0), rooms::point(x, 4, 3), rooms::point(x, 0, 3)}, 0);
  const auto room = rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.2f, 1.f)});
  const FieldGrid grid(*room, 1.f);
  for (const std::uint32_t start : {FieldGrid::no_cell, FieldGrid::gap}) {
    std::vector<FieldGrid::Crossing> crossings;
    EXPECT_EQ(grid.cross(rooms::point(2.205, 1.1, 0.4), rooms::point(0, 0.6, 0.8), 2.5f, crossings, start), FieldGrid::gap);
    EXPECT_TRUE(crossings.empty());
  }
  // Beside the sheets there is no gap: a segment that leaves a gap has a cell again.
  std::vector<FieldGrid::Crossing> crossings;
  const std::uint32_t end = grid.cross(rooms::point(1.5, 1.1, 0.4), rooms::point(0, 0.6, 0.8), 2.5f, crossings, FieldGrid::gap);
  ASSERT_LT(end, grid.size());
  EXPECT_LT(grid.inside(end).x, 2.2f);
}

TEST(FieldGrid, BlendingIsTrilinearBetweenCentres) {
  const auto room = rooms::shoe1(0.2, 1);
  const FieldGrid grid(*room, 1.f);
  std::array<FieldGrid::CellWeight, 8> fractions;
  // The centre of a box is its own alone; half way between two centres each has half.
  ASSERT_EQ(grid.blend(rooms::point(2.5, 1.5, 1.5), fractions), 1u);
  EXPECT_FLOAT_EQ(fractions[0].weight, 1.f);
  ASSERT_EQ(grid.blend(rooms::point(3.0, 1.5, 1.5), fractions), 2u);
  EXPECT_NEAR(fractions[0].weight, 0.5f, 1e-5f);
}

TEST(FieldGrid, HugeAndEmptyScenesStayBounded) {
  EXPECT_EQ(FieldGrid(*rooms::empty(), 1.f).size(), 0u);
  const FieldGrid plain(*rooms::half_space(0.5, 1), 1.f);
  EXPECT_LE(plain.size(), 2u * 16'384u);
  std::array<FieldGrid::CellWeight, 8> fractions;
  EXPECT_EQ(FieldGrid(*rooms::empty(), 1.f).blend({0, 0, 0}, fractions), 0u);
}

}  // namespace
}  // namespace earshot
