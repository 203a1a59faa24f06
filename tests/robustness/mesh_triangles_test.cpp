// SPDX-License-Identifier: Apache-2.0
// Single triangles that are wrong, doubled, or lie on each other (docs/evidence/stability.md, H-1 to H-6).

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

#include "sim/acoustics/response/energy_response.h"
#include "sim/base/errors.h"
#include "sim/scene/mesh/mesh_repair.h"
#include "tests/support/files/mesh_cases.h"

namespace earshot {
namespace {

using namespace mesh_cases;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

const DoubleMesh& room() {
  static const DoubleMesh mesh = box({5, 3, 4});
  return mesh;
}

TEST(H1_TriangleWithoutArea, LeavesTheRestBitEqual) {
  const ImportedMesh clean = import("room.obj", obj_text(room()));
  // Two equal corners, three equal corners, three on a line, and one of them far away, which must not blunt the welding of the rest.
  const std::string degenerate =
      "v 1 1 1\nv 1 1 1\nv 2 2 2\nv 3 3 3\nv 9e8 9e8 9e8\nf 9 9 11\nf 9 9 9\nf 9 10 11\nf 9 11 12\nf 13 13 13\nf 1 1 2\n";
  const ImportedMesh repaired = import("room.obj", obj_text(room()) + degenerate);
  EXPECT_EQ(repaired.report.degenerate_removed, 6u);
  EXPECT_EQ(repaired.report.triangles_read, 18u);
  EXPECT_EQ(hash_of(repaired.mesh), hash_of(clean.mesh));
  EXPECT_EQ(repaired.mesh.vertices.size(), 8u);
  EXPECT_TRUE(repaired.report.warnings.empty()) << "what was removed does not count for the size of the scene";
}

// Built by hand, past the repair: rays still see no number that is not one.
TEST(H1_TriangleWithoutArea, PastTheRepairRaysStayFinite) {
  TriangleMesh mesh;
  for (const glm::dvec3 v : room().vertices) mesh.vertices.emplace_back(v);
  mesh.triangles = room().triangles;
  const auto scene_without = scene_of(mesh);
  for (const glm::uvec3 bad : {glm::uvec3(0, 0, 1), glm::uvec3(3, 3, 3), glm::uvec3(0, 7, 0)}) mesh.triangles.push_back(bad);
  const auto scene = scene_of(mesh);
  for (std::uint32_t i = 0; i < 20'000; ++i) {
    const Hit hit = scene->rays().intersect({2, 1, 1.5f}, random_direction(i)),
              expected = scene_without->rays().intersect({2, 1, 1.5f}, random_direction(i));
    ASSERT_EQ(hit.triangle, expected.triangle);
    ASSERT_EQ(hit.distance_m, expected.distance_m);
    ASSERT_EQ(hit.normal, expected.normal);
  }
}

// 1 m by 1e-7 m, standing in the room: kept, with a true normal, and found where it is.
TEST(H2_Needle, IsKeptWithItsNormal) {
  for (const double width_m : {1e-3, 1e-5, 1e-7}) {
    // Two needles make a strip whose width a float can tell (around zero), in the plane z = 2.
    DoubleMesh mesh = room();
    mesh.vertices.insert(mesh.vertices.end(), {{1, 0, 2}, {2, 0, 2}, {2, width_m, 2}, {1, width_m, 2}});
    mesh.triangles.insert(mesh.triangles.end(), {{8, 9, 10}, {8, 10, 11}});
    const ImportedMesh imported = import("needle.obj", obj_text(mesh));
    const bool is_welded = width_m < 7e-6;  // 1e-6 of the diagonal of 7.07 m: its long edges are one line for us
    EXPECT_EQ(imported.mesh.triangles.size(), is_welded ? 12u : 14u) << width_m;
    EXPECT_EQ(imported.report.degenerate_removed, is_welded ? 2u : 0u) << width_m;

    TriangleMesh whole;
    for (const glm::dvec3 v : mesh.vertices) whole.vertices.emplace_back(v);
    whole.triangles = mesh.triangles;
    const auto scene = scene_of(whole);
    const auto w = static_cast<float>(width_m);
    const Hit hit = scene->rays().intersect({1.3f, 0.4f * w, 1}, {0, 0, 1});
    ASSERT_TRUE(hit.valid());
    EXPECT_GE(hit.triangle, 12u) << width_m;
    EXPECT_EQ(hit.distance_m, 1.f) << width_m;
    EXPECT_NEAR(hit.normal.z, -1, 1e-6f) << width_m;
    EXPECT_LT(glm::length(hit.position - glm::vec3(1.3f, 0.4f * w, 2)), 5e-6f)
        << width_m << ": sixteen roundings of 2 m at most, as a needle is narrower than the margin of its edges";
  }
}

TEST(H3_VertexThatIsNoNumber, IsRefusedWithItsIndex) {
  const auto error = [](const std::string& name, const std::string& bytes) { return message_of<InputError>([&] { import(name, bytes); }); };
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(), 1e10}) {
    DoubleMesh mesh = room();
    mesh.vertices[5].y = bad;
    for (const auto& [name, bytes] : {std::pair{"a.obj", obj_text(mesh)},
                                      {"b.ply", ply_file(mesh, PlyBody::floats)},
                                      {"c.ply", ply_file(mesh, PlyBody::doubles)},
                                      {"d.ply", ply_file(mesh, PlyBody::text)},
                                      {"e.stl", stl_binary(mesh)},
                                      {"f.gltf", gltf_file(mesh)}}) {
      const std::string message = error(name, bytes);
      EXPECT_THAT(message, AllOf(HasSubstr("vertex "), HasSubstr("not finite or farther than 1e+09 m"), Not(HasSubstr("\n"))))
          << name << " " << bad;
      // OBJ and STL have a vertex per corner by then: their number is that of the corner.
      const bool counts_corners = std::string_view(name) == "a.obj" || std::string_view(name) == "e.stl";
      EXPECT_TRUE(counts_corners || message.find("vertex 5 ") != std::string::npos) << name << ": " << message;
    }
  }
}

TEST(H4_IndexOutOfRange, IsRefusedBeforeItIsRead) {
  DoubleMesh mesh = room();
  for (const std::uint32_t bad : {8u, 0x7FFFFFFFu, 0xFFFFFFFEu}) {
    mesh.triangles[3].y = bad;
    for (const auto& [name, bytes] : {std::pair{"a.ply", ply_file(mesh, PlyBody::floats)},
                                      {"b.ply", ply_file(mesh, PlyBody::text)},
                                      {"c.gltf", gltf_file(mesh)},
                                      {"d.obj", obj_text(mesh)}}) {
      const std::string message = message_of<InputError>([&, &name = name, &bytes = bytes] { import(name, bytes); });
      EXPECT_THAT(message, AllOf(HasSubstr(name), Not(HasSubstr("\n")))) << bad;
    }
  }
  EXPECT_NE(message_of<InputError>([] { import("e.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -9\n"); }), "") << "relative to what is there";
}

// Doubled and turned copies, with vertices of their own: the mesh is that without them, so all results have its bits.
TEST(H5_DuplicateTriangle, IsRemovedAndCounted) {
  const ImportedMesh clean = import("room.obj", obj_text(room()));
  DoubleMesh twice = room();
  for (const glm::uvec3 t : room().triangles) {
    const auto first = static_cast<std::uint32_t>(twice.vertices.size());
    for (int corner = 0; corner < 3; ++corner) twice.vertices.push_back(room().vertices[t[corner]]);
    twice.triangles.emplace_back(first + 1, first, first + 2);  // the other winding
  }
  const ImportedMesh repaired = import("room.obj", obj_text(twice));
  EXPECT_EQ(repaired.report.duplicate_removed, 12u);
  EXPECT_EQ(hash_of(repaired.mesh), hash_of(clean.mesh));
}

// Past the repair (a scene built in memory): the copies lose every tie, so a wall reflects once, and lets through once.
TEST(H5_DuplicateTriangle, PastTheRepairTheFirstIsTheOneThatIsHit) {
  TriangleMesh mesh;
  for (const glm::dvec3 v : room().vertices) mesh.vertices.emplace_back(v);
  mesh.triangles = room().triangles;
  const auto once = scene_of(mesh);
  mesh.triangles.insert(mesh.triangles.end(), room().triangles.begin(), room().triangles.end());
  const auto twice = scene_of(mesh);
  AcousticConfig config;
  config.rays = 500;
  config.bands = 1;
  EnergyResponse a, b;
  for (const auto& [scene, response] : {std::pair(once, &a), std::pair(twice, &b)}) {
    const AcousticScene acoustics(scene, config);
    compute_energy_response(acoustics, EarlyCandidates(acoustics, glm::vec3(1.2f, 1.1f, 1.5f)), {3.8f, 1.6f, 2.3f}, *response);
  }
  ASSERT_EQ(a.arrivals.size(), b.arrivals.size()) << "no image twice";
  for (std::size_t i = 0; i < a.arrivals.size(); ++i) EXPECT_EQ(a.arrivals[i].amplitude[0], b.arrivals[i].amplitude[0]);
  EXPECT_TRUE(std::ranges::equal(a.late.values(), b.late.values()));
}

/// Overlapping rectangles in one plane that stands at an angle to all axes, each cut into triangles in its own way.
struct Overlap {
  TriangleMesh mesh;
  glm::vec3 centre, u, v;  ///< of the plane
};

Overlap overlapping_plane(glm::vec3 centre, glm::vec3 normal) {
  Overlap overlap{{}, centre, {}, {}};
  const glm::vec3 helper = std::fabs(normal.y) < 0.9f ? glm::vec3(0, 1, 0) : glm::vec3(1, 0, 0);
  overlap.u = glm::normalize(glm::cross(normal, helper));
  overlap.v = glm::cross(normal, overlap.u);
  const std::array<std::array<float, 4>, 4> rectangles = {
      {{-2, -2, 2, 2}, {-2.3f, -2.1f, 2.2f, 2.4f}, {-3, -3, 3, 3}, {-2, -2.5f, 2.5f, 2}}};
  for (const auto& r : rectangles) {
    const auto first = static_cast<std::uint32_t>(overlap.mesh.vertices.size());
    for (const auto& [s, t] : {std::pair{r[0], r[1]}, {r[2], r[1]}, {r[2], r[3]}, {r[0], r[3]}})
      overlap.mesh.vertices.push_back(centre + s * overlap.u + t * overlap.v);
    overlap.mesh.triangles.emplace_back(first, first + 1, first + 2);
    overlap.mesh.triangles.emplace_back(first, first + 2, first + 3);
  }
  return overlap;
}

// Axis-aligned planes: EmbreeScene.CoplanarTrianglesGiveTheLowestId.  Tilted ones have rounded corners, so their planes differ a little.
TEST(H6_CoplanarOverlap, LowestIdWinsFromEveryDirectionOnTiltedPlanes) {
  for (std::uint32_t plane = 0; plane < 40; ++plane) {
    const glm::vec3 normal = random_direction(plane, 1), centre = (plane % 2 ? 1.f : 20.f) * random_direction(plane, 2);
    const Overlap overlap = overlapping_plane(centre, normal);
    const auto scene = scene_of(overlap.mesh);
    for (std::uint32_t i = 0; i < 2000; ++i) {
      const auto x = RandomStream(17, Purpose::test, plane, i).uniform4(0);
      const glm::vec3 target = centre + (3 * x[0] - 1.5f) * overlap.u + (3 * x[1] - 1.5f) * overlap.v;
      // From grazing (about 3 degrees) to upright, from both sides.
      const float height = (i % 2 ? 1.f : -1.f) * (0.2f + 3 * x[2]);
      const glm::vec3 origin = target + height * normal + (4 * x[3] - 2) * overlap.u;
      const Hit hit = scene->rays().intersect(origin, glm::normalize(target - origin));
      ASSERT_TRUE(hit.valid());
      ASSERT_LE(hit.triangle, 1u) << "plane " << plane << ", ray " << i;
    }
  }
}

// The same energy whichever way sound goes: source and listener exchanged see the same winner (absorption 0.9 over 0.1 on one plane).
TEST(H6_CoplanarOverlap, ReciprocityHoldsOverAnOverlap) {
  Overlap overlap = overlapping_plane({0, 0, 0}, glm::normalize(glm::vec3(0.2f, 1, -0.3f)));
  overlap.mesh.material_names = {"hard", "soft"};
  overlap.mesh.triangle_material = {1, 1, 0, 0, 0, 0, 0, 0};
  overlap.mesh.triangle_object.assign(8, 0);
  overlap.mesh.object_names = {"o"};
  const auto scene = std::make_shared<const Scene>(
      "test", overlap.mesh, std::vector{Material::uniform("hard", 0.1f, 0), Material::uniform("soft", 0.9f, 0)}, Air{});
  AcousticConfig config;
  config.bands = 1;
  config.air_absorption = Switch::off;
  config.diffraction = Switch::off;
  const AcousticScene acoustics(scene, config);
  const glm::vec3 a(0.4f, 1.3f, 0.2f), b(-0.7f, 1.1f, -0.5f);
  EnergyResponse forward, backward;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, a), b, forward);
  compute_energy_response(acoustics, EarlyCandidates(acoustics, b), a, backward);
  ASSERT_EQ(forward.arrivals.size(), 2u) << "direct and one reflection";
  ASSERT_EQ(backward.arrivals.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) EXPECT_FLOAT_EQ(forward.arrivals[i].amplitude[0], backward.arrivals[i].amplitude[0]);
  // The soft one has the lowest id: amplitude sqrt(1 - 0.9) / (4 pi r).
  const double r = forward.arrivals[1].distance_m;
  EXPECT_NEAR(forward.arrivals[1].amplitude[0] * 4 * 3.14159265358979 * r, std::sqrt(0.1), 1e-5);
}

// One wall of a thousand kilometres: vertices of the chairs stay apart.
TEST(X_HugeAmongSmall, RepairKeepsTheSmallOnes) {
  DoubleMesh mesh = box({0.01, 0.01, 0.01});
  mesh.vertices.insert(mesh.vertices.end(), {{-1e6, -1, -1e6}, {1e6, -1, -1e6}, {0, -1, 1e6}});
  mesh.triangles.emplace_back(8, 9, 10);
  const ImportedMesh imported = import("mixed.obj", obj_text(mesh));
  EXPECT_EQ(imported.mesh.triangles.size(), 13u);
  EXPECT_EQ(imported.mesh.vertices.size(), 11u);
}

// Against all pairs: two vertices join if both tolerances allow it.
TEST(X_HugeAmongSmall, WeldingByVertexMatchesBruteForce) {
  std::vector<glm::vec3> vertices;
  std::vector<float> tolerance_m;
  for (std::uint32_t i = 0; i < 1200; ++i) {
    const auto u = RandomStream(3, Purpose::test, i).uniform4(0);
    vertices.emplace_back(u[0] - 0.5f, u[1] - 0.5f, u[2] - 0.5f);
    tolerance_m.push_back(i % 7 == 0 ? 0.f : 0.2f * std::exp2(-9 * u[3]));
  }
  const std::vector<std::uint32_t> first = weld_map(vertices, tolerance_m);
  int joined = 0;
  for (std::uint32_t i = 0; i < vertices.size(); ++i) {
    std::uint32_t expected = i;
    for (std::uint32_t j = 0; j < i && expected == i; ++j) {
      const double apart = glm::length(glm::dvec3(vertices[i]) - glm::dvec3(vertices[j]));
      if (first[j] == j && apart <= std::min(tolerance_m[i], tolerance_m[j])) expected = j;
    }
    ASSERT_EQ(first[i], expected);
    joined += expected != i;
  }
  EXPECT_GT(joined, 50);
}

}  // namespace
}  // namespace earshot
