// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/folded_planes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/vec2.hpp>
#include <numbers>

#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

/// Strips 3 m high over points (x, y), one material.
TriangleMesh strips(std::span<const glm::dvec2> points) {
  TriangleMesh mesh;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const glm::dvec2 a = points[i], b = points[i + 1];
    rooms::append_quad(mesh, {rooms::point(a.x, a.y, 0), rooms::point(b.x, b.y, 0), rooms::point(b.x, b.y, 3), rooms::point(a.x, a.y, 3)},
                       0);
  }
  return mesh;
}

TriangleMesh zigzag(double depth_m, int count) {
  std::vector<glm::dvec2> points;
  for (int i = 0; i <= count; ++i) points.emplace_back(i % 2 == 1 ? depth_m : 0.0, 0.6 * i);
  return strips(points);
}

FoldedPlanes folds_of(const TriangleMesh& mesh) { return find_folded_planes(mesh, find_mirror_planes(mesh), 0.3); }

TEST(FoldedPlanes, AZigzagIsOneThroughItsMiddle) {
  const FoldedPlanes folds = folds_of(zigzag(0.04, 10));
  ASSERT_EQ(folds.planes.size(), 1u);
  EXPECT_NEAR(folds.depth_m[0], 0.04, 1e-5);
  const glm::dvec3 x(rooms::point(1, 0, 0)), normal(folds.planes[0].normal);
  EXPECT_NEAR(std::abs(glm::dot(x, normal)), 1, 1e-6);
  EXPECT_NEAR(double{folds.planes[0].offset_m} * glm::dot(x, normal), 0.02, 1e-5);
  EXPECT_NEAR(folds.planes[0].area_m2, 10 * 3 * std::hypot(0.6, 0.04), 1e-3);
  ASSERT_EQ(folds.fold_of_triangle.size(), 20u);
  for (const std::uint32_t fold : folds.fold_of_triangle) EXPECT_EQ(fold, 0u);
}

TEST(FoldedPlanes, WindingDoesNotMatter) {
  TriangleMesh mesh = zigzag(0.04, 10);
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) std::swap(mesh.triangles[i].y, mesh.triangles[i].z);
  ASSERT_EQ(folds_of(mesh).planes.size(), 1u);
  EXPECT_NEAR(folds_of(mesh).depth_m[0], 0.04, 1e-5);
}

TEST(FoldedPlanes, FlatDeepSteepAndRoundAreNone) {
  EXPECT_TRUE(folds_of(zigzag(0, 10)).planes.empty());    // one plane
  EXPECT_TRUE(folds_of(zigzag(0.2, 10)).planes.empty());  // turns by 37 degrees
  std::vector<glm::dvec2> column, bow;
  for (int i = 0; i <= 36; ++i) {
    const double angle = i * std::numbers::pi / 18;
    column.emplace_back(0.3 * std::cos(angle), 0.3 * std::sin(angle));
    bow.emplace_back(8 * std::cos(0.05 * angle), 8 * std::sin(0.05 * angle));
  }
  EXPECT_TRUE(folds_of(strips(column)).planes.empty());  // leans all round
  EXPECT_EQ(folds_of(strips(bow)).planes.size(), 1u);    // 0.1 m deep
  for (glm::dvec2& point : bow) point *= 4;
  EXPECT_TRUE(folds_of(strips(bow)).planes.empty());  // 0.4 m deep
  TriangleMesh box;
  rooms::append_box(box, {0, 0, 0}, {6, 7.2, 4}, 0);
  EXPECT_TRUE(folds_of(box).planes.empty());
  EXPECT_TRUE(folds_of(box).fold_of_triangle.empty());
  EXPECT_TRUE(folds_of(TriangleMesh{}).planes.empty());
}

}  // namespace
}  // namespace earshot
