// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/hole_finder.h"

#include <gtest/gtest.h>

#include "sim/scene/scene_report.h"

namespace earshot {
namespace {

void append_rectangle(TriangleMesh& mesh, glm::vec3 corner, glm::vec3 along, glm::vec3 across, std::uint32_t object) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (const glm::vec3 vertex : {corner, corner + along, corner + along + across, corner + across}) mesh.vertices.push_back(vertex);
  mesh.triangles.insert(mesh.triangles.end(), {{first, first + 1, first + 2}, {first, first + 2, first + 3}});
  mesh.triangle_material.insert(mesh.triangle_material.end(), 2, 0u);
  mesh.triangle_object.insert(mesh.triangle_object.end(), 2, object);
}

/// 5 x 3 x 4 m; the wall x = 5 has a hole of `size` x `size` m around (5, 1.5, 2), and there may be no ceiling.
Scene room(float size, bool ceiling) {
  TriangleMesh mesh;
  mesh.material_names = {"plaster"};
  mesh.object_names = {"floor", "ceiling", "wall", "holed_wall"};
  append_rectangle(mesh, {0, 0, 0}, {5, 0, 0}, {0, 0, 4}, 0);
  if (ceiling) append_rectangle(mesh, {0, 3, 0}, {5, 0, 0}, {0, 0, 4}, 1);
  append_rectangle(mesh, {0, 0, 0}, {0, 3, 0}, {0, 0, 4}, 2);
  append_rectangle(mesh, {0, 0, 0}, {5, 0, 0}, {0, 3, 0}, 2);
  append_rectangle(mesh, {0, 0, 4}, {5, 0, 0}, {0, 3, 0}, 2);
  const float half = 0.5f * size;
  append_rectangle(mesh, {5, 0, 0}, {0, 1.5f - half, 0}, {0, 0, 4}, 3);
  append_rectangle(mesh, {5, 1.5f + half, 0}, {0, 1.5f - half, 0}, {0, 0, 4}, 3);
  if (size > 0) {
    append_rectangle(mesh, {5, 1.5f - half, 0}, {0, size, 0}, {0, 0, 2 - half}, 3);
    append_rectangle(mesh, {5, 1.5f - half, 2 + half}, {0, size, 0}, {0, 0, 2 - half}, 3);
  }
  return Scene("room", mesh, {Material::uniform("plaster", 0.1f, 0.5f)}, {});
}

TEST(HoleFinder, AClosedRoomHasNone) { EXPECT_TRUE(find_holes(room(0, true)).empty()); }

TEST(HoleFinder, NamesTheHoleItsPlaceAndItsFraction) {
  const Scene scene = room(0.6f, true);
  const std::vector<Hole> holes = find_holes(scene);
  ASSERT_EQ(holes.size(), 1u);
  const Hole& hole = holes[0];
  const glm::vec3 centre = 0.5f * (hole.bounds.lower + hole.bounds.upper);
  EXPECT_NEAR(centre.x, 5.0, 0.1);  // places along a ray are at most 2 % of its length apart
  EXPECT_NEAR(centre.y, 1.5, 0.1);
  EXPECT_NEAR(centre.z, 2.0, 0.1);
  EXPECT_LT(hole.bounds.upper.y - hole.bounds.lower.y, 0.75);
  EXPECT_GT(hole.bounds.upper.y - hole.bounds.lower.y, 0.4);
  // The report counts the same rays.
  EXPECT_NEAR(hole.ray_fraction, report_scene(scene).leaked_ray_fraction, 1e-9);
  ASSERT_FALSE(hole.rim.empty());
  EXPECT_EQ(hole.rim[0], "holed_wall (plaster)");
}

TEST(HoleFinder, AMissingCeilingIsOneLargeHoleAtItsHeight) {
  const std::vector<Hole> holes = find_holes(room(0, false));
  ASSERT_FALSE(holes.empty());
  EXPECT_NEAR(holes[0].ray_fraction, report_scene(room(0, false)).leaked_ray_fraction, 0.01);
  EXPECT_GT(holes[0].bounds.upper.x - holes[0].bounds.lower.x, 4.0);
  EXPECT_GT(holes[0].bounds.upper.z - holes[0].bounds.lower.z, 3.0);
  EXPECT_GT(holes[0].bounds.upper.y, 2.5);
}

TEST(HoleFinder, AnEmptySceneHasNone) { EXPECT_TRUE(find_holes(Scene("empty", {}, {}, {})).empty()); }

TEST(HoleFinder, SameSeedSameAnswer) {
  const Scene scene = room(0.6f, true);
  const auto first = find_holes(scene, 7), again = find_holes(scene, 7);
  ASSERT_EQ(first.size(), again.size());
  for (std::size_t i = 0; i < first.size(); ++i) EXPECT_EQ(first[i].bounds.lower, again[i].bounds.lower);
}

}  // namespace
}  // namespace earshot
