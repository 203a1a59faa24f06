// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/mesh_simplify.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/errors.h"
#include "sim/scene/scene.h"

namespace earshot {
namespace {

/// A 4 x 4 m square of n x n cells in the plane y = 0, lifted by height(x, z).
template <class Height>
TriangleMesh sheet(int n, Height height) {
  TriangleMesh mesh;
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      const float x = 4.f * static_cast<float>(i) / static_cast<float>(n), z = 4.f * static_cast<float>(j) / static_cast<float>(n);
      mesh.vertices.emplace_back(x, height(x, z), z);
    }
  }
  const auto at = [n](int i, int j) { return static_cast<std::uint32_t>(i * (n + 1) + j); };
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      mesh.triangles.emplace_back(at(i, j), at(i, j + 1), at(i + 1, j));
      mesh.triangles.emplace_back(at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
    }
  }
  mesh.triangle_material.assign(mesh.triangles.size(), 0);
  mesh.triangle_object.assign(mesh.triangles.size(), 0);
  mesh.material_names = {"a", "b"};
  mesh.object_names = {"sheet"};
  return mesh;
}

double area_of(const TriangleMesh& mesh, std::uint32_t material) {
  double area = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.triangle_material[t] != material) continue;
    const glm::dvec3 a = mesh.vertices[mesh.triangles[t].x], b = mesh.vertices[mesh.triangles[t].y], c = mesh.vertices[mesh.triangles[t].z];
    area += 0.5 * glm::length(glm::cross(b - a, c - a));
  }
  return area;
}

TEST(MeshSimplify, AFlatSheetKeepsItsBorderAndAreaWithFarFewerTriangles) {
  TriangleMesh mesh = sheet(40, [](float, float) { return 0.f; });
  const SimplifyReport report = simplify_mesh(mesh, 0.001f);
  EXPECT_EQ(report.triangles_before, 3200u);
  EXPECT_EQ(report.triangles_after, mesh.triangles.size());
  EXPECT_LT(report.triangles_after, 400u);  // 160 border vertices alone need 158 triangles
  EXPECT_NEAR(area_of(mesh, 0), 16.0, 1e-4);
  EXPECT_LT(report.deviation_m, 1e-6);
}

TEST(MeshSimplify, MaterialsKeepTheirAreas) {
  TriangleMesh mesh = sheet(40, [](float, float) { return 0.f; });
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    mesh.triangle_material[t] = mesh.vertices[mesh.triangles[t].x].x < 0.95f ? 0u : 1u;
  const double first = area_of(mesh, 0), second = area_of(mesh, 1);
  simplify_mesh(mesh, 0.05f);
  EXPECT_NEAR(area_of(mesh, 0), first, 1e-4);
  EXPECT_NEAR(area_of(mesh, 1), second, 1e-4);
}

// A dome of radius 10 m: the distance of any point of the simplified surface from the sphere is known.  Between its vertices a flat
// triangle leaves the sphere by as much again as its vertices may, hence the factor of two for centroids.
TEST(MeshSimplify, StaysWithinTheDeviationAskedForAndSaysWhatItIs) {
  const auto dome = [](float x, float z) { return std::sqrt(100.f - (x - 2) * (x - 2) - (z - 2) * (z - 2)); };
  std::size_t fewer = 100000;
  for (const float deviation_m : {0.001f, 0.01f, 0.05f}) {
    TriangleMesh mesh = sheet(60, dome);
    const SimplifyReport report = simplify_mesh(mesh, deviation_m);
    EXPECT_LT(report.triangles_after, fewer);
    fewer = report.triangles_after;
    double measured_m = 0;
    for (const glm::uvec3 t : mesh.triangles) {
      const glm::dvec3 centroid = (glm::dvec3(mesh.vertices[t.x]) + glm::dvec3(mesh.vertices[t.y]) + glm::dvec3(mesh.vertices[t.z])) / 3.0;
      measured_m = std::max(measured_m, std::abs(glm::length(centroid - glm::dvec3(2, 0, 2)) - 10.0));
    }
    EXPECT_LT(measured_m, 2 * deviation_m);
    EXPECT_LE(report.deviation_m, deviation_m);
    EXPECT_GT(report.deviation_m, 0.05 * deviation_m);
  }
}

TEST(MeshSimplify, DistanceToATriangleInEveryRegion) {
  const glm::dvec3 a(0, 0, 0), b(2, 0, 0), c(0, 2, 0);
  const auto distance = [&](double x, double y, double z) { return distance_to_triangle({x, y, z}, a, b, c); };
  EXPECT_DOUBLE_EQ(distance(0.5, 0.5, 3), 3);
  EXPECT_DOUBLE_EQ(distance(-3, -4, 0), 5);
  EXPECT_DOUBLE_EQ(distance(5, 0, 4), 5);
  EXPECT_DOUBLE_EQ(distance(0, 6, 3), 5);
  EXPECT_DOUBLE_EQ(distance(1, -2, 0), 2);
  EXPECT_DOUBLE_EQ(distance(-2, 1, 0), 2);
  EXPECT_DOUBLE_EQ(distance(2, 2, 0), std::numbers::sqrt2);
}

TEST(MeshSimplify, RefusesADeviationThatIsNone) {
  TriangleMesh mesh = sheet(2, [](float, float) { return 0.f; });
  EXPECT_THROW(simplify_mesh(mesh, 0.f), InputError);
  EXPECT_THROW(simplify_mesh(mesh, std::nanf("")), InputError);
  EXPECT_THROW(simplify_mesh(mesh, 2.f), InputError);
}

TEST(MeshSimplify, AnEmptyMeshStaysEmpty) {
  TriangleMesh mesh;
  EXPECT_EQ(simplify_mesh(mesh, 0.01f).triangles_after, 0u);
}

}  // namespace
}  // namespace earshot
