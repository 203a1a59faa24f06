// SPDX-License-Identifier: Apache-2.0
// Every file of shared/data/meshes_hard and scenes/formats: loads as stated, or is refused in one line as stated.

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/scene_report.h"
#include "tests/support/files/mesh_cases.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

/// What another loader (index.json of the data: counts before any repair) and the eye say about a file.
struct Expected {
  const char* refusal;                                ///< part of the message; null: it loads
  std::uint64_t triangles, open_edges, shared_edges;  ///< shared: edges of more than two triangles
  double lower[3], upper[3];
  std::vector<const char*> warnings;  ///< part of each
};

Expected refused(const char* why) { return {why, 0, 0, 0, {}, {}, {}}; }
Expected loads(std::uint64_t triangles, std::uint64_t open, std::uint64_t shared, std::array<double, 3> lower, std::array<double, 3> upper,
               std::vector<const char*> warnings = {}) {
  return {nullptr, triangles, open, shared, {lower[0], lower[1], lower[2]}, {upper[0], upper[1], upper[2]}, std::move(warnings)};
}

const std::map<std::string, Expected>& expectations() {
  static const std::map<std::string, Expected> table{
      {"meshes_hard/ballA.off", refused("unknown extension")},
      {"meshes_hard/empty.obj", refused("has no triangles")},
      {"meshes_hard/empty.ply", refused("has no triangles")},
      {"meshes_hard/empty.stl", refused("has no triangles")},
      {"meshes_hard/featuretype.STL", loads(3476, 0, 0, {-2.5, -1.25, 0}, {2.5, 1.25, 1.375})},
      {"meshes_hard/groups.obj", loads(2308, 0, 0, {-4.713, -2.554, 0}, {4.713, 2.382, 4})},
      {"meshes_hard/large_block.STL", loads(12, 0, 0, {0, -152.4, 0}, {4572, 152.4, 2438.4}, {"is the unit right?"})},
      {"meshes_hard/multibody.stl", loads(32, 0, 0, {-0.511, -0.719, -0.052}, {0.125, 0.37, 0.288})},
      {"meshes_hard/nancolor.obj", loads(12, 0, 0, {-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5})},
      {"meshes_hard/not_convex.obj", loads(96, 0, 12, {-0.366, 0, 0}, {0, 0.762, 0.762})},
      {"meshes_hard/obj_wireframe.obj", refused("has no triangles")},
      {"meshes_hard/ply_empty_header.ply", refused("has no triangles")},
      {"meshes_hard/points_emptyface.ply", refused("has no triangles")},
      {"meshes_hard/ray_data.json", refused("unknown extension")},
      {"meshes_hard/soup.stl", loads(100, 300, 0, {0.002, 0.003, 0.006}, {1, 0.999, 0.999})},
      {"meshes_hard/stl_empty_bin.stl", refused("has no triangles")},
      {"meshes_hard/tube.obj", loads(120, 0, 0, {-0.832, 0, -0.833}, {0.832, 11.844, 0.833}, {"missing (fat_pipe.mtl)"})},
      {"meshes_hard/unit_cube.STL", loads(12, 0, 0, {-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5})},
      {"meshes_hard/wallhole.obj", loads(66, 0, 0, {0, 0, -10}, {10, 15, 0}, {"missing (00.mtl)"})},
      {"scenes/formats/batch-four-squares-deep-hierarchy-whole-file.bin", refused("unknown extension")},
      {"scenes/formats/batch-four-squares-deep-hierarchy-whole-file.gltf", loads(8, 16, 0, {-0.9, -0.9, 0}, {0.9, 0.9, 0})},
      {"scenes/formats/boxroom.obj", loads(12, 0, 0, {-8, -2, -8}, {8, 4, 8}, {"missing (boxroom.mtl)"})},
      {"scenes/formats/chair.glb", loads(1008, 0, 0, {-0.335, -0.657, -0.21}, {0.187, 0.243, 0.222})},
      {"scenes/formats/cornell_box.obj",
       loads(34, 4, 0, {0, 0, 0}, {556, 548.8, 559.2}, {"missing (cornell_box.mtl)", "is the unit right?"})},
      {"scenes/formats/nested_box.glb", loads(24, 0, 0, {-0.517, -0.32, -0.439}, {0.517, 0.32, 0.439})},
      {"scenes/formats/simple_room.glb", loads(84, 0, 0, {-5.247, -5.398, -0.061}, {5.28, 5.449, 2.154})},
      {"scenes/formats/simplescene.obj",
       loads(108, 0, 0, {-6.503, -3.724, -32.511}, {33.545, 4.295, 15.249}, {"missing (simplescene.mtl)"})},
      {"scenes/formats/skinned_prism.glb", loads(768, 0, 0, {-1, 0, -1}, {1, 6, 1})},
      {"scenes/formats/smallbox.obj", loads(12, 0, 0, {-0.4, -0.4, -0.4}, {0.4, 0.4, 0.4}, {"missing (smallbox.mtl)"})},
      {"scenes/formats/stage_floor1.glb", loads(2048, 128, 0, {-9.999, -0.793, -9.999}, {9.999, 1.078, 9.999})},
      {"scenes/formats/transform_box.glb", loads(12, 0, 0, {-1, -1, -1}, {1, 1, 1})},
  };
  return table;
}

struct EdgeCounts {
  std::uint64_t open = 0, shared = 0;
};

EdgeCounts count_edges(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
  for (const glm::uvec3 t : mesh.triangles)
    for (int corner = 0; corner < 3; ++corner) ++uses[std::minmax(t[corner], t[(corner + 1) % 3])];
  EdgeCounts counts;
  for (const auto& [edge, count] : uses) {
    counts.open += count == 1;
    counts.shared += count > 2;
  }
  return counts;
}

TEST(X_MeshFiles, EachLoadsOrIsRefusedAsStated) {
  SKIP_WITHOUT_DATA("meshes_hard");
  std::set<std::string> seen;
  fmt::print("{:<66} {:>9} {:>7} {:>7} {:>7}  {}\n", "file", "triangles", "removed", "open", "shared", "outcome");
  for (const char* folder : {"meshes_hard", "scenes/formats"}) {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(data_folder() / folder)) names.insert(entry.path().filename().string());
    for (const std::string& name : names) {
      const std::string key = std::string(folder) + "/" + name;
      const auto found = expectations().find(key);
      ASSERT_NE(found, expectations().end()) << key << ": nothing is stated about this file";
      const Expected& expected = found->second;
      seen.insert(key);
      ImportedMesh imported;
      const std::string message = message_of<InputError>([&] { imported = import_mesh(data_folder() / key); });
      if (!message.empty()) {
        fmt::print("{:<66} {:>9} {:>7} {:>7} {:>7}  refused: {}\n", key, "-", "-", "-", "-", message.substr(message.find(name)));
        ASSERT_NE(expected.refusal, nullptr) << message;
        EXPECT_THAT(message, AllOf(HasSubstr(name), HasSubstr(expected.refusal), Not(HasSubstr("\n")))) << key;
        continue;
      }
      EXPECT_EQ(expected.refusal, nullptr) << key << " loads";
      const ImportReport& report = imported.report;
      const EdgeCounts edges = count_edges(imported.mesh);
      const std::uint64_t removed = report.degenerate_removed + report.duplicate_removed;
      fmt::print("{:<66} {:>9} {:>7} {:>7} {:>7}  loads{}\n", key, imported.mesh.triangles.size(), removed, edges.open, edges.shared,
                 report.warnings.empty() ? "" : ", warned: " + report.warnings[0]);
      EXPECT_EQ(imported.mesh.triangles.size() + removed, report.triangles_read) << key;
      EXPECT_EQ(report.triangles_read, expected.triangles) << key;
      EXPECT_EQ(edges.open, expected.open_edges) << key;
      EXPECT_EQ(edges.shared, expected.shared_edges) << key;
      const Bounds bounds = bounds_of(imported.mesh);
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(bounds.lower[axis], expected.lower[axis], 6e-4) << key << ": three digits are stated";
        EXPECT_NEAR(bounds.upper[axis], expected.upper[axis], 6e-4) << key;
      }
      EXPECT_EQ(imported.mesh.origin_m, glm::dvec3(0)) << key;
      ASSERT_EQ(report.warnings.size(), expected.warnings.size()) << key;
      for (std::size_t i = 0; i < expected.warnings.size(); ++i) EXPECT_THAT(report.warnings[i], HasSubstr(expected.warnings[i])) << key;
    }
  }
  EXPECT_EQ(seen.size(), expectations().size()) << "a file is stated and not there";
}

// What loads can be used: rays, the report and its holes end, and give finite numbers.
TEST(X_MeshFiles, WhatLoadsCanBeExplored) {
  SKIP_WITHOUT_DATA("meshes_hard");
  for (const auto& [key, expected] : expectations()) {
    if (expected.refusal) continue;
    const Scene scene = load_scene((data_folder() / key).string());
    const SceneReport report = report_scene(scene);
    EXPECT_GE(report.ray_efficiency, 0) << key;
    EXPECT_LE(report.ray_efficiency, 1) << key;
    EXPECT_TRUE(std::isfinite(report.volume_m3)) << key;
    const glm::vec3 size = scene.bounds().upper - scene.bounds().lower;
    for (std::uint32_t i = 0; i < 2000; ++i) {
      const auto u = RandomStream(4, Purpose::test, i).uniform4(0);
      const glm::vec3 origin = scene.bounds().lower - 0.1f * size + 1.2f * size * glm::vec3(u[0], u[1], u[2]);
      const Hit hit = scene.rays().intersect(origin, mesh_cases::random_direction(i));
      if (!hit.valid()) continue;
      ASSERT_TRUE(std::isfinite(hit.distance_m + hit.position.x + hit.position.y + hit.position.z)) << key;
      ASSERT_NEAR(glm::length(hit.normal), 1, 1e-5f) << key;
    }
  }
}

/// Distance to the nearest triangle along a ray, in double, by trying all of them (Moeller and Trumbore 1997); negative if none.
double nearest_by_brute_force(const TriangleMesh& mesh, glm::dvec3 origin, glm::dvec3 direction, double& edge_distance) {
  double nearest = -1;
  edge_distance = 1;
  for (const glm::uvec3 t : mesh.triangles) {
    const glm::dvec3 a = mesh.vertices[t.x], e1 = glm::dvec3(mesh.vertices[t.y]) - a, e2 = glm::dvec3(mesh.vertices[t.z]) - a;
    const glm::dvec3 p = glm::cross(direction, e2);
    const double determinant = glm::dot(e1, p);
    if (std::fabs(determinant) < 1e-300) continue;
    const glm::dvec3 s = origin - a, q = glm::cross(s, e1);
    const double u = glm::dot(s, p) / determinant, v = glm::dot(direction, q) / determinant, d = glm::dot(e2, q) / determinant;
    const double inside = std::min({u, v, 1 - u - v});
    if (d > 0 && std::fabs(inside) < 1e-5) edge_distance = std::min(edge_distance, std::fabs(inside));
    if (inside >= 0 && d > 0 && (nearest < 0 || d < nearest)) nearest = d;
  }
  return nearest;
}

// The rays that come with the meshes (made to graze and to run along edges), against all triangles in double.
TEST(X_MeshFiles, TheirOwnRaysHitWhatBruteForceHits) {
  SKIP_WITHOUT_DATA("meshes_hard");
  const auto rays = nlohmann::json::parse(std::ifstream(data_folder() / "meshes_hard/ray_data.json"))["rays"]["featuretype.STL"];
  const TriangleMesh mesh = import_mesh(data_folder() / "meshes_hard/featuretype.STL").mesh;
  const EmbreeScene scene(mesh.vertices, mesh.triangles);
  int hits = 0, near_edges = 0;
  for (std::size_t i = 0; i < rays["ray_origins"].size(); ++i) {
    const auto o = rays["ray_origins"][i].get<std::array<double, 3>>(), d = rays["ray_directions"][i].get<std::array<double, 3>>();
    const glm::vec3 origin(o[0], o[1], o[2]), direction = glm::normalize(glm::vec3(d[0], d[1], d[2]));
    double edge_distance = 1;
    const double expected = nearest_by_brute_force(mesh, origin, direction, edge_distance);
    const Hit hit = scene.intersect(origin, direction);
    near_edges += edge_distance < 1e-5;
    if (edge_distance < 1e-5) continue;  // through an edge: which side is a matter of rounding
    ASSERT_EQ(hit.valid(), expected > 0) << i;
    if (!hit.valid()) continue;
    ++hits;
    EXPECT_NEAR(hit.distance_m, expected, 2e-5 * (1 + expected)) << i;
  }
  EXPECT_GT(hits, 100);
  EXPECT_LT(near_edges, 200);
}

}  // namespace
}  // namespace earshot
