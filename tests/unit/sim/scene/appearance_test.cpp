// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/appearance.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <set>

#include "sim/base/errors.h"
#include "sim/scene/color.h"
#include "tests/support/files/gltf_files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

void expect_color(glm::vec3 found, glm::vec3 expected) {
  for (int channel = 0; channel < 3; ++channel) EXPECT_NEAR(found[channel], expected[channel], 2e-6f) << channel;
}

glm::vec3 decoded(float r, float g, float b) { return {decode_srgb(r), decode_srgb(g), decode_srgb(b)}; }

const std::string& category_of(const Scene& scene, const Appearance& appearance, const std::string& object) {
  const TriangleMesh& mesh = scene.mesh();
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    if (mesh.object_names[mesh.triangle_object[t]] == object) return category_names()[appearance.triangle_category[t]];
  static const std::string missing_name = "no such object";
  return missing_name;
}

TEST(Appearance, CategoriesAreNumberedOnce) {
  const std::vector<std::string>& names = category_names();
  EXPECT_EQ(names.front(), "unknown");
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), names.size());
  EXPECT_EQ(names.back(), "agent");
  EXPECT_TRUE(std::is_sorted(names.begin() + 1, names.end() - 1));
  EXPECT_LE(names.size(), 256u);  // pictures of categories are palette images
}

TEST(Appearance, HouseHasColoursAndCategoriesOfItsObjects) {
  const Scene scene = load_scene("house:1,rooms=4");
  const auto appearance = load_appearance(scene);
  ASSERT_EQ(appearance->triangle_color.size(), scene.mesh().triangles.size());
  EXPECT_FALSE(appearance->detail);
  std::set<std::string> seen;
  for (std::size_t t = 0; t < scene.mesh().triangles.size(); ++t) {
    const std::string& object = scene.mesh().object_names[scene.mesh().triangle_object[t]];
    const std::string& category = category_names()[appearance->triangle_category[t]];
    EXPECT_EQ(object.substr(0, object.rfind('_')), category) << object;
    seen.insert(category);
    for (int channel = 0; channel < 3; ++channel)
      EXPECT_TRUE(appearance->triangle_color[t][channel] >= 0 && appearance->triangle_color[t][channel] <= 1);
  }
  EXPECT_GT(seen.size(), 6u);
}

TEST(Appearance, ObjTakesKdAndObjectNames) {
  const TempFolder folder;
  folder.write("room.mtl", "newmtl red\nKd 1 0.5 0\nnewmtl plain\nKd 0.2 0.2 0.2\n");
  const std::string file = folder.write("room.obj",
                                        "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\no table_3\nusemtl red\nf 1 2 3\n"
                                        "o thing\nusemtl plain\nf 1 2 4\n");
  const Scene scene = load_scene(file);
  const auto appearance = load_appearance(scene);
  EXPECT_FALSE(appearance->detail);
  EXPECT_EQ(category_of(scene, *appearance, "table_3"), "table");
  EXPECT_EQ(category_of(scene, *appearance, "thing"), "unknown");
  for (std::size_t t = 0; t < 2; ++t) {
    const bool table = scene.mesh().object_names[scene.mesh().triangle_object[t]] == "table_3";
    expect_color(appearance->triangle_color[t], table ? decoded(1, 0.5f, 0) : decoded(0.2f, 0.2f, 0.2f));
  }
}

// Colours that are not numbers, or out of range, give a valid colour; a comment after a name does not belong to it.
TEST(Appearance, ColoursThatAreNoNumbersAreBlack) {
  const TempFolder folder;
  folder.write("room.mtl", "newmtl odd # of an exporter\nKd nan nan inf\n");
  const std::string file =
      folder.write("room.obj", "mtllib room.mtl\nv 0 0 0 nan inf -1e40\nv 1 0 0 0 0 0\nv 0 1 0 2 2 2\no thing\nusemtl odd\nf 1 2 3\n");
  const Scene scene = load_scene(file);
  const auto appearance = load_appearance(scene);
  ASSERT_FALSE(appearance->triangle_color.empty());
  for (const glm::vec3 color : appearance->triangle_color)
    for (int channel = 0; channel < 3; ++channel) EXPECT_TRUE(color[channel] >= 0.f && color[channel] <= 1.f) << color[channel];
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(to_srgb8({nan, -nan, 2.f}), (std::array<std::uint8_t, 3>{0, 0, 255}));
}

TEST(Appearance, PlyColoursOfVerticesAreKeptInDetail) {
  const TempFolder folder;
  const std::string file =
      folder.write("scan.ply",
                   "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
                   "property uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
                   "0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 51\n3 0 1 2\n");
  const Scene scene = load_scene(file);
  const auto appearance = load_appearance(scene);
  ASSERT_TRUE(appearance->detail);
  const VisualMesh& mesh = appearance->detail->mesh;
  ASSERT_EQ(mesh.triangles.size(), 1u);
  for (int corner = 0; corner < 3; ++corner) {
    const std::uint32_t vertex = mesh.triangles[0][corner];
    const glm::vec3 at = mesh.vertices[vertex];
    expect_color(mesh.colors[vertex], at.x > 0 ? decoded(0, 1, 0) : at.y > 0 ? decoded(0, 0, 0.2f) : decoded(1, 0, 0));
  }
  EXPECT_FALSE(load_appearance(scene, {}, {.detail = false})->detail);
}

TEST(Appearance, GltfBaseColourIsLinearAlready) {
  const TempFolder folder;
  GltfWriter writer;
  writer.json["meshes"].push_back(
      {{"primitives", {{{"attributes", {{"POSITION", writer.add_positions({0, 0, 0, 1, 0, 0, 0, 1, 0})}}}, {"material", 0}}}}});
  writer.json["materials"] = {{{"name", "paint"}, {"pbrMetallicRoughness", {{"baseColorFactor", {0.25, 0.5, 0.75, 1.0}}}}}};
  writer.json["nodes"].push_back({{"mesh", 0}, {"name", "Sofa.001"}});
  const Scene scene = load_scene(folder.write("a.gltf", writer.gltf()));
  const auto appearance = load_appearance(scene);
  expect_color(appearance->triangle_color.at(0), {0.25f, 0.5f, 0.75f});
  EXPECT_EQ(category_of(scene, *appearance, "Sofa.001"), "sofa");
}

TEST(Appearance, CategoriesAreThoseOfWholeNamesWithoutTheirIndex) {
  const TempFolder folder;
  const std::vector<std::pair<std::string, std::string>> expected{{"ChairA_01_001", "chair"},
                                                                  {"NightStand_01_002", "nightstand"},
                                                                  {"Coffee-Table.B", "coffee_table"},
                                                                  {"TV_02", "tv"},
                                                                  {"FloorLamp_3", "unknown"},
                                                                  {"vegetable_1", "unknown"},
                                                                  {"Wall", "wall"},
                                                                  {"wallart_A", "unknown"},
                                                                  {"house/Sofa_01b", "sofa"},
                                                                  {"house/SofaB_7", "sofa"}};
  std::string text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (std::size_t i = 0; i < expected.size(); ++i) text += fmt::format("v 0 0 {}\no {}\nf 1 2 {}\n", i + 1, expected[i].first, i + 4);
  const Scene scene = load_scene(folder.write("named.obj", text));
  const auto appearance = load_appearance(scene);
  for (const auto& [name, category] : expected) EXPECT_EQ(category_of(scene, *appearance, name), category) << name;
}

TEST(Appearance, FileWithoutColoursTakesThoseOfItsMaterials) {
  const TempFolder folder;
  const std::string file = folder.write("room.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\no brick_rough\nusemtl brick_rough\nf 1 2 3\n");
  const auto appearance = load_appearance(load_scene(file));
  EXPECT_FALSE(appearance->detail);
  EXPECT_GT(appearance->triangle_color.at(0).x, 2 * appearance->triangle_color.at(0).z);  // brick is red
}

TEST(Appearance, LiesWhereTheSceneLies) {
  // A mesh a million metres away is moved near the origin, and the looks with it.
  const TempFolder folder;
  const std::string file = folder.write("far.obj",
                                        "v 1000000 0 0 1 0 0\nv 1000004 0 0 0 1 0\nv 1000000 4 0 0 0 1\nv 1000000 0 4 1 1 1\n"
                                        "f 1 2 3\nf 1 2 4\n");
  const Scene scene = load_scene(file);
  const auto appearance = load_appearance(scene);
  ASSERT_TRUE(appearance->detail);
  for (const glm::vec3 vertex : appearance->detail->mesh.vertices)
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_TRUE(vertex[axis] >= scene.bounds().lower[axis] - 1e-3f && vertex[axis] <= scene.bounds().upper[axis] + 1e-3f);
}

TEST(Appearance, MissingAndDamagedTexturesAreRefusedInOneLine) {
  const TempFolder folder;
  GltfWriter writer;
  const std::size_t positions = writer.add_positions({0, 0, 0, 1, 0, 0, 0, 1, 0});
  writer.json["meshes"].push_back({{"primitives", {{{"attributes", {{"POSITION", positions}}}, {"material", 0}}}}});
  writer.json["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  writer.json["textures"] = {{{"source", 0}}};
  writer.json["nodes"].push_back({{"mesh", 0}});
  const auto message_for = [&](const std::string& uri) {
    writer.json["images"] = {{{"uri", uri}}};
    const Scene scene = load_scene(folder.write("a.gltf", writer.gltf()));
    return message_of<InputError>([&] { static_cast<void>(load_appearance(scene)); });
  };
  EXPECT_THAT(message_for("none.png"), testing::HasSubstr("none.png"));
  folder.write("cut.png", "\x89PNG\r\n\x1a\n and no more");
  EXPECT_THAT(message_for("cut.png"), testing::HasSubstr("is not a complete PNG"));
  folder.write("cut.jpg", "\xFF\xD8\xFF\xE0 and no more");
  EXPECT_THAT(message_for("cut.jpg"), testing::HasSubstr("is not a complete JPEG"));
  folder.write("other.ktx2", "something else");
  EXPECT_EQ(message_for("other.ktx2"), "");  // a warning
}

}  // namespace
}  // namespace earshot
