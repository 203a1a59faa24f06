// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/panel_shapes.h"

#include <gtest/gtest.h>

#include <numbers>
#include <tuple>

#include "sim/acoustics/model/acoustic_surfaces.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

AcousticSurfaces surfaces_of(TriangleMesh mesh) {
  AcousticConfig config;
  config.diffraction = Switch::on;
  return {rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)}), config};
}

double drawn(std::uint32_t index, std::uint32_t draw, double low, double high) {
  return low + (high - low) * RandomStream(39, Purpose::test, index).uniform(draw);
}

void append_rectangle(TriangleMesh& mesh, glm::dvec3 centre, glm::dvec3 half_a, glm::dvec3 half_b) {
  rooms::append_quad(mesh,
                     {glm::vec3(centre - half_a - half_b), glm::vec3(centre - half_a + half_b), glm::vec3(centre + half_a + half_b),
                      glm::vec3(centre + half_a - half_b)},
                     0);
}

TEST(PanelShapes, DrawnSheetsInARoomAreFoundWithTheirSides) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {40, 12, 12}, 0);
  std::array<double, 10> area_m2;
  for (std::uint32_t i = 0; i < 10; ++i) {
    const double turn = drawn(i, 0, 0, 2 * std::numbers::pi), a = drawn(i, 1, 0.2, 1.5), b = drawn(i, 2, 0.2, 1.5);
    append_rectangle(mesh, {3.6 * i + 3.0, 5, -6}, a * glm::dvec3(std::cos(turn), std::sin(turn), 0), {0, 0, b});
    area_m2[i] = 4 * a * b;
  }
  const AcousticSurfaces surfaces = surfaces_of(std::move(mesh));
  ASSERT_NE(surfaces.panel_shapes(), nullptr);
  const std::span<const PanelShape> shapes = surfaces.panel_shapes()->all();
  ASSERT_EQ(shapes.size(), 20u);  // two sides each; no wall of the room
  for (std::uint32_t i = 0; i < 10; ++i) {
    int sides = 0;
    for (const PanelShape& shape : shapes) {
      if (glm::length(shape.centre - glm::dvec3(3.6 * i + 3.0, 5, -6)) > 0.01) continue;
      ++sides;
      EXPECT_NEAR(shape.area_m2(), area_m2[i], 0.01 * area_m2[i]);
      EXPECT_TRUE(shape.is_sheet);
      EXPECT_TRUE(shape.holds(shape.centre + 0.9 * shape.half_side_m[0] * shape.axis[0] - 0.9 * shape.half_side_m[1] * shape.axis[1]));
      EXPECT_FALSE(shape.holds(shape.centre + 1.1 * shape.half_side_m[0] * shape.axis[0]));
      EXPECT_EQ(surfaces.panel_shapes()->find(shape.plane, shape.centre, shape.centre + shape.normal), &shape);
      // The disc of the square: 4 / (3 pi) of its radius, of the same area; the strip: pi / 4 of its half width.
      EXPECT_LT(shape.low_ratio_m, 0.25 * std::numbers::pi * std::min(shape.half_side_m[0], shape.half_side_m[1]));
      EXPECT_GT(shape.low_ratio_m, 0.49 * std::min(shape.half_side_m[0], shape.half_side_m[1]));
    }
    EXPECT_EQ(sides, 2) << i;
  }
}

TEST(PanelShapes, ThinBoxesAreSheetsAndCubesAreNot) {
  for (const double thick_m : {0.05, 1.0}) {
    TriangleMesh mesh;
    rooms::append_box(mesh, {0, 0, 0}, {1, 1.2, thick_m}, 0);
    const AcousticSurfaces surfaces = surfaces_of(std::move(mesh));
    int large = 0;
    for (const PanelShape& shape : surfaces.panel_shapes()->all()) {
      if (shape.area_m2() < 0.9) continue;
      ++large;
      EXPECT_EQ(shape.is_sheet, thick_m < 0.1);
    }
    EXPECT_EQ(large, thick_m < 0.1 ? 2 : 6);
  }
}

TEST(PanelShapes, HolesAndSmallSheetsAreNone) {
  TriangleMesh mesh;  // a frame of 3 m about a hole of 1 m, and a slat of 0.2 m
  for (const double side : {-1.0, 1.0}) {
    append_rectangle(mesh, {side, 0, 0}, {0.5, 0, 0}, {0, 0, 1.5});
    append_rectangle(mesh, {0, 0, side}, {0.5, 0, 0}, {0, 0, 0.5});
  }
  append_rectangle(mesh, {0, 4, 0}, {0.1, 0, 0}, {0, 0, 2});
  const AcousticSurfaces surfaces = surfaces_of(std::move(mesh));
  for (const PanelShape& shape : surfaces.panel_shapes()->all()) {
    EXPECT_LT(shape.centre.y, 1);
    EXPECT_GT(shape.area_m2(), 8);  // never the hole
  }
}

TEST(PanelShapes, DrawnSheetsThatStandOnTheFloorAreDoubled) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {40, 12, 12}, 0);
  std::array<double, 10> height_m, length_m;
  for (std::uint32_t i = 0; i < 10; ++i) {
    height_m[i] = drawn(i, 3, 0.3, 2), length_m[i] = drawn(i, 4, 0.5, 3);
    const double turn = drawn(i, 5, 0, 2 * std::numbers::pi);
    append_rectangle(mesh, {3.6 * i + 3.0, 0.5 * height_m[i], -6}, {0, 0.5 * height_m[i], 0},
                     0.5 * length_m[i] * glm::dvec3(std::cos(turn), 0, std::sin(turn)));
  }
  const AcousticSurfaces surfaces = surfaces_of(std::move(mesh));
  const std::span<const PanelShape> shapes = surfaces.panel_shapes()->all();
  ASSERT_EQ(shapes.size(), 20u);
  for (std::uint32_t i = 0; i < 10; ++i) {
    int sides = 0;
    for (const PanelShape& shape : shapes) {
      if (glm::length(shape.centre - glm::dvec3(3.6 * i + 3.0, 0, -6)) > 0.02) continue;
      ++sides;
      EXPECT_TRUE(shape.stands());
      EXPECT_TRUE(shape.is_sheet);
      EXPECT_GT(shape.up.y, 0.999);
      EXPECT_NEAR(shape.height_m(), height_m[i], 0.01);
      EXPECT_NEAR(2 * shape.half_side_m[0], length_m[i], 0.01 * length_m[i] + 0.01);
      EXPECT_EQ(shape.base_panel, PanelShape::kNone);
      EXPECT_EQ(shape.back_plane, shape.plane);
      EXPECT_LT(glm::length(shape.in_base({1, 2, 3}) - glm::dvec3(1, -2, 3)), 0.02);
    }
    EXPECT_EQ(sides, 2) << i;
  }
}

TEST(PanelShapes, FurnitureAndDoorwaysDoNotStand) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {10, 3, 8}, 0);
  rooms::append_box(mesh, {1, 0, -2}, {2, 0.8, -1}, 0);  // on the floor
  // A wall with a doorway from side to side.
  for (const auto& [from, to, low, high] : {std::tuple(0.0, 3.0, 0.0, 3.0), std::tuple(4.0, 8.0, 0.0, 3.0), std::tuple(3.0, 4.0, 2.1, 3.0)})
    append_rectangle(mesh, {5, 0.5 * (low + high), -0.5 * (from + to)}, {0, 0.5 * (high - low), 0}, {0, 0, 0.5 * (to - from)});
  const AcousticSurfaces surfaces = surfaces_of(std::move(mesh));
  for (const PanelShape& shape : surfaces.panel_shapes()->all()) EXPECT_FALSE(shape.stands()) << shape.centre.x << " " << shape.centre.y;
}

TEST(PanelShapes, OfTwoSheetsThatEndAtEachOtherTheLowerStands) {
  for (std::uint32_t i = 0; i < 10; ++i) {
    const double width_m = drawn(i, 6, 1.6, 3), height_m = drawn(i, 7, 0.4, 1.2);
    TriangleMesh mesh;
    append_rectangle(mesh, {0, 0, 0}, {0.5 * width_m, 0, 0}, {0, 0, 2});
    append_rectangle(mesh, {-0.5 * width_m, 0.5 * height_m, 0}, {0, 0.5 * height_m, 0}, {0, 0, 2});
    const AcousticSurfaces surfaces = surfaces_of(std::move(mesh));
    int standing = 0, lying = 0;
    for (const PanelShape& shape : surfaces.panel_shapes()->all()) {
      (shape.stands() ? standing : lying) += 1;
      if (!shape.stands()) continue;
      EXPECT_NEAR(shape.height_m(), height_m, 0.01);
      ASSERT_NE(shape.base_panel, PanelShape::kNone);
      EXPECT_GT(surfaces.panel_shapes()->all()[shape.base_panel].normal.y, 0.99);
    }
    EXPECT_EQ(standing, 2) << i;
    EXPECT_EQ(lying, 2) << i;
  }
}

}  // namespace
}  // namespace earshot
