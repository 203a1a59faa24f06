// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/polygon.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <numbers>

namespace earshot {
namespace {

/// Sum of the areas, each signed along `normal`: equals the polygon's area only if no triangle is flipped or overlaps outside.
std::pair<double, double> areas(const std::vector<glm::vec3>& corners, glm::dvec3 normal) {
  std::vector<std::uint32_t> indices;
  triangulate_polygon(corners, indices);
  EXPECT_EQ(indices.size(), 3 * (corners.size() - 2));
  double with_sign = 0, absolute = 0;
  for (std::size_t i = 0; i < indices.size(); i += 3) {
    const glm::dvec3 a = corners.at(indices[i]), b = corners.at(indices[i + 1]), c = corners.at(indices[i + 2]);
    const double area = glm::dot(glm::cross(b - a, c - a), normal) / 2;
    with_sign += area;
    absolute += std::fabs(area);
  }
  return {with_sign, absolute};
}

TEST(TriangulatePolygon, ConcavePolygonsKeepTheirArea) {
  // An L of area 3 and an arrow of area 2 - 1 = 1, in three planes and both windings.
  const std::vector<std::pair<std::vector<glm::dvec2>, double>> shapes{{{{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}}, 3},
                                                                       {{{0, 0}, {1, -1}, {0, 1}, {-1, -1}}, 1},
                                                                       {{{0, 0}, {1, 0}, {2, 0}, {2, 1}, {1, 1}, {0, 1}}, 2}};
  for (const auto& [shape, area] : shapes) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const bool reversed : {false, true}) {
        std::vector<glm::vec3> corners;
        for (const glm::dvec2 p : shape) {
          glm::vec3 corner;
          corner[axis] = 5;
          corner[(axis + 1) % 3] = static_cast<float>(p.x);
          corner[(axis + 2) % 3] = static_cast<float>(p.y);
          corners.push_back(corner);
        }
        if (reversed) std::reverse(corners.begin(), corners.end());
        glm::dvec3 normal(0);
        normal[axis] = reversed ? -1 : 1;
        const auto [with_sign, absolute] = areas(corners, normal);
        EXPECT_NEAR(with_sign, area, 1e-6);
        EXPECT_NEAR(absolute, area, 1e-6) << "no triangle is flipped";
      }
    }
  }
}

TEST(TriangulatePolygon, StarOfManyCorners) {
  std::vector<glm::vec3> corners;
  constexpr int n = 400;
  for (int i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * i / n, radius = i % 2 ? 1 : 0.5;
    corners.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 0);
  }
  const double area = n * 0.5 * 0.5 * std::sin(2 * std::numbers::pi / n);  // n triangles of sides 1 and 1/2
  const auto [with_sign, absolute] = areas(corners, {0, 0, 1});
  EXPECT_NEAR(with_sign, area, 1e-5);
  EXPECT_NEAR(absolute, area, 1e-5);
}

TEST(TriangulatePolygon, DegenerateOnesEnd) {
  areas({{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 0, 1});  // crosses itself
  areas({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}}, {0, 0, 1});
  areas(std::vector<glm::vec3>(6, glm::vec3(1)), {0, 0, 1});
  std::vector<std::uint32_t> indices;
  triangulate_polygon(std::vector<glm::vec3>(2), indices);
  EXPECT_TRUE(indices.empty());
}

}  // namespace
}  // namespace earshot
