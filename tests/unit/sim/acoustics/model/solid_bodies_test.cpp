// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/solid_bodies.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <vector>

#include "sim/base/random.h"

namespace earshot {
namespace {

/// Adds a tetrahedron with corners of its own or shared ones.
void append_tetrahedron(TriangleMesh& mesh, const std::array<glm::vec3, 4>& corners, bool outward, bool shared) {
  const bool turned = glm::dot(glm::cross(corners[1] - corners[0], corners[2] - corners[0]), corners[3] - corners[0]) > 0;
  std::array<std::array<int, 3>, 4> faces{{{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {0, 2, 3}}};
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  if (shared) mesh.vertices.insert(mesh.vertices.end(), corners.begin(), corners.end());
  for (auto& face : faces) {
    if (turned == outward) std::swap(face[1], face[2]);
    std::array<std::uint32_t, 3> at{};
    for (std::size_t i = 0; i < 3; ++i) {
      at[i] = shared ? first + static_cast<std::uint32_t>(face[i]) : static_cast<std::uint32_t>(mesh.vertices.size());
      if (!shared) mesh.vertices.push_back(corners[static_cast<std::size_t>(face[i])]);
    }
    mesh.triangles.emplace_back(at[0], at[1], at[2]);
    mesh.triangle_material.push_back(0);
  }
}

// Bodies, rooms and open surfaces in any order and anywhere; the winding that is outward follows from the determinant of the corners.
TEST(SolidBodies, AreClosedAndWoundOutward) {
  for (std::uint32_t number = 0; number < 30; ++number) {
    const RandomStream random(39, Purpose::test, number);
    TriangleMesh mesh;
    std::vector<std::uint8_t> expected;
    for (std::uint32_t body = 0; body < 5; ++body) {
      const auto draw = [&](std::uint32_t i) { return random.uniform(40 * body + i); };
      const glm::vec3 place(300 * draw(0) - 150, 10 * static_cast<float>(body), 300 * draw(1) - 150);
      std::array<glm::vec3, 4> corners;
      for (std::uint32_t i = 0; i < 4; ++i) corners[i] = place + glm::vec3(draw(2 + 3 * i), draw(3 + 3 * i), draw(4 + 3 * i)) * 3.f;
      const bool outward = draw(20) < 0.6f, open = draw(21) < 0.3f;
      append_tetrahedron(mesh, corners, outward, draw(22) < 0.5f);
      if (open) {
        mesh.triangles.pop_back();
        mesh.triangle_material.pop_back();
      }
      expected.resize(mesh.triangles.size(), outward && !open);
    }
    EXPECT_EQ(bounds_of_bodies(mesh), expected) << number;
  }
}

TEST(SolidBodies, AnEmptyMeshHasNone) { EXPECT_TRUE(bounds_of_bodies({}).empty()); }

}  // namespace
}  // namespace earshot
