// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/mesh_repair.h"

#include <gtest/gtest.h>

#include "sim/base/random.h"

namespace earshot {
namespace {

TriangleMesh soup(std::vector<glm::vec3> vertices, std::vector<glm::uvec3> triangles) {
  TriangleMesh mesh;
  mesh.vertices = std::move(vertices);
  mesh.triangles = std::move(triangles);
  mesh.triangle_material.assign(mesh.triangles.size(), 0);
  mesh.triangle_object.assign(mesh.triangles.size(), 0);
  mesh.material_names = {"m"};
  mesh.object_names = {"o"};
  return mesh;
}

TEST(WeldMap, NamesTheFirstVertexWithinTheTolerance) {
  const std::vector<glm::vec3> vertices{{0, 0, 0}, {1, 0, 0}, {0.0009f, 0, 0}, {-0.0f, 0, 0}, {0.0021f, 0, 0}, {1.0009f, 0, 0}};
  EXPECT_EQ(weld_map(vertices, 0.001f), (std::vector<std::uint32_t>{0, 1, 0, 0, 4, 1}));
  EXPECT_EQ(weld_map(vertices, 0), (std::vector<std::uint32_t>{0, 1, 2, 0, 4, 5})) << "0 and -0 are one position";
}

// Against all pairs: vertices are kept if no kept one before them lies within the tolerance.
TEST(WeldMap, MatchesBruteForce) {
  std::vector<glm::vec3> vertices;
  for (std::uint32_t i = 0; i < 1500; ++i) {
    const auto u = RandomStream(1, Purpose::test, i).uniform4(0);
    vertices.emplace_back(u[0] - 0.5f, u[1] - 0.5f, u[2] - 0.5f);
  }
  constexpr float tolerance = 0.04f;
  const std::vector<std::uint32_t> first = weld_map(vertices, tolerance);
  std::size_t welded = 0;
  for (std::uint32_t i = 0; i < vertices.size(); ++i) {
    std::uint32_t expected = i;
    for (std::uint32_t j = 0; j < i && expected == i; ++j) {
      const glm::dvec3 apart = glm::dvec3(vertices[i]) - glm::dvec3(vertices[j]);
      if (first[j] == j && apart.x * apart.x + apart.y * apart.y + apart.z * apart.z <= double{tolerance} * tolerance) expected = j;
    }
    EXPECT_EQ(first[i], expected);
    welded += expected != i;
  }
  EXPECT_GT(welded, 100u);
}

// docs/evidence/stability.md, H-1, H-2, H-5.
TEST(RepairMesh, RemovesWhatHasNoAreaOrIsThereTwice) {
  TriangleMesh mesh = soup({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 0}, {2, 0, 0}, {0.5f, 1e-7f, 0}, {9, 9, 9}},
                           {{0, 1, 2},    // kept
                            {3, 2, 1},    // the same, other winding and a copy of vertex 0
                            {0, 1, 4},    // on a line
                            {0, 0, 1},    // two equal vertices
                            {0, 3, 1}});  // two equal positions
  ImportReport report;
  repair_mesh(mesh, report);
  EXPECT_EQ(mesh.triangles, (std::vector<glm::uvec3>{{0, 1, 2}}));
  EXPECT_EQ(mesh.vertices.size(), 3u) << "unused vertices go";
  EXPECT_EQ(mesh.triangle_material.size(), 1u);
  EXPECT_EQ(mesh.triangle_object.size(), 1u);
  EXPECT_EQ(report.degenerate_removed, 3u);
  EXPECT_EQ(report.duplicate_removed, 1u);
  EXPECT_EQ(report.vertices_welded, 1u);
}

TEST(RepairMesh, KeepsNeedlesThatHaveAnArea) {
  TriangleMesh mesh = soup({{0, 0, 0}, {0.1f, 0, 0}, {0.05f, 3e-6f, 0}}, {{0, 1, 2}});
  ImportReport report;
  repair_mesh(mesh, report);
  EXPECT_EQ(mesh.triangles.size(), 1u) << "dropping it would open a crack between its neighbours";
}

TEST(RepairMesh, WeldsRoundingButNotDetail) {
  // A diagonal of about 10 m: 1e-5 m is the limit.
  TriangleMesh mesh = soup({{0, 0, 0}, {10, 0, 0}, {0, 1, 0}, {5e-6f, 0, 0}, {0, 1, 1e-3f}, {1, 1, 1}}, {{0, 1, 2}, {3, 4, 5}});
  ImportReport report;
  repair_mesh(mesh, report);
  EXPECT_EQ(report.vertices_welded, 1u);
  EXPECT_EQ(mesh.vertices.size(), 5u);
  EXPECT_EQ(mesh.triangles[1].x, 0u);
}

TEST(RepairMesh, LeavesACleanMeshAlone) {
  TriangleMesh mesh;
  mesh.material_names = {"m"};
  mesh.object_names = {"o"};
  append_box(mesh, {0, 0, 0}, {1, 2, 3}, 0, 0);
  ImportReport report;
  repair_mesh(mesh, report);
  EXPECT_EQ(mesh.triangles.size(), 12u);
  EXPECT_EQ(mesh.vertices.size(), 8u);
  EXPECT_EQ(report.degenerate_removed + report.duplicate_removed + report.vertices_welded, 0u);
}

}  // namespace
}  // namespace earshot
