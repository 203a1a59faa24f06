// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/triangle_mesh.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>

#include "sim/base/text/text_match.h"

namespace earshot {
namespace {

TriangleMesh box() {
  TriangleMesh mesh;
  mesh.material_names = {"paint"};
  mesh.object_names = {"box_0"};
  append_box(mesh, {-1, 0, 2}, {1, 3, 4}, 0, 0);
  return mesh;
}

TEST(TriangleMesh, BoxIsClosedAndFacesOutward) {
  const TriangleMesh mesh = box();
  ASSERT_EQ(mesh.triangles.size(), 12u);
  double volume = 0, area = 0;  // divergence theorem: signed tetrahedra over the origin
  for (const glm::uvec3 t : mesh.triangles) {
    const glm::dvec3 a = mesh.vertices[t.x], b = mesh.vertices[t.y], c = mesh.vertices[t.z];
    volume += glm::dot(a, glm::cross(b, c)) / 6;
    area += glm::length(glm::cross(b - a, c - a)) / 2;
  }
  EXPECT_DOUBLE_EQ(volume, 2 * 3 * 2);
  EXPECT_DOUBLE_EQ(area, 2 * (2 * 3 + 3 * 2 + 2 * 2));
}

TEST(TriangleMesh, BoundsCoverTrianglesOnly) {
  TriangleMesh mesh = box();
  mesh.vertices.emplace_back(100, 100, 100);
  const Bounds bounds = bounds_of(mesh);
  EXPECT_EQ(bounds.lower, glm::vec3(-1, 0, 2));
  EXPECT_EQ(bounds.upper, glm::vec3(1, 3, 4));
  const Bounds empty = bounds_of({});
  EXPECT_GT(empty.lower.x, empty.upper.x);
}

TEST(TriangleMesh, HashSeesEveryArrayAndName) {
  const std::uint64_t hash = hash_of(box());
  EXPECT_EQ(hash, hash_of(box()));
  TriangleMesh changed = box();
  changed.vertices[3].y += 1e-6f;
  EXPECT_NE(hash_of(changed), hash);
  changed = box();
  std::swap(changed.triangles[0].x, changed.triangles[0].y);
  EXPECT_NE(hash_of(changed), hash);
  changed = box();
  changed.triangle_material[5] = 1;
  EXPECT_NE(hash_of(changed), hash);
  changed = box();
  changed.triangle_object[5] = 1;
  EXPECT_NE(hash_of(changed), hash);
  changed = box();
  changed.material_names[0] = "paint2";
  EXPECT_NE(hash_of(changed), hash);
  changed = box();
  changed.object_names.emplace_back();
  EXPECT_NE(hash_of(changed), hash);
}

TEST(TriangleMesh, InternKeepsOneOfEach) {
  std::vector<std::string> names;
  EXPECT_EQ(intern(names, "a"), 0u);
  EXPECT_EQ(intern(names, "b"), 1u);
  EXPECT_EQ(intern(names, "a"), 0u);
  EXPECT_EQ(names.size(), 2u);
}

TEST(GlobMatch, KnowsStarAndQuestionMark) {
  for (const auto& [pattern, text] : std::vector<std::pair<std::string, std::string>>{{"*", ""},
                                                                                      {"*", "abc"},
                                                                                      {"a*c", "abbbc"},
                                                                                      {"a*c", "ac"},
                                                                                      {"?b?", "abc"},
                                                                                      {"*Table*", "CoffeeTable/M"},
                                                                                      {"**", "x"},
                                                                                      {"a*b*c", "aXbXbXc"},
                                                                                      {"", ""},
                                                                                      {"Bed/Material #?", "Bed/Material #3"}}) {
    EXPECT_TRUE(glob_match(pattern, text)) << pattern << " " << text;
  }
  for (const auto& [pattern, text] : std::vector<std::pair<std::string, std::string>>{
           {"", "a"}, {"a", ""}, {"?", ""}, {"a*c", "abd"}, {"Bed", "Bed2"}, {"bed*", "Bed"}, {"a*b", "abc"}, {"??", "a"}}) {
    EXPECT_FALSE(glob_match(pattern, text)) << pattern << " " << text;
  }
  EXPECT_FALSE(glob_match("*a*a*a*a*a*a*a*a*a*a*b", std::string(20'000, 'a'))) << "and in bounded time";
}

}  // namespace
}  // namespace earshot
