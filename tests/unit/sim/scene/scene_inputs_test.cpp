// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene_inputs.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

TEST(SceneInputs, GeneratedScenesAreTheirText) {
  const auto one = hash_of_scene_inputs("house:1");
  ASSERT_TRUE(one);
  EXPECT_EQ(hash_of_scene_inputs("house:1"), one);
  EXPECT_NE(hash_of_scene_inputs("house:2"), one);
  EXPECT_NE(hash_of_scene_inputs("shoebox:4x3x5"), hash_of_scene_inputs("shoebox:4x3x6"));
  EXPECT_FALSE(hash_of_scene_inputs("no_such.glb"));
  EXPECT_FALSE(hash_of_scene_inputs("no scene at all"));
  EXPECT_FALSE(hash_of_scene_inputs("no_such.yaml"));
}

/// The hash changes with these bytes of a file that the scene names, and comes back with them.
void expect_depends_on(const TempFolder& folder, const std::string& scene, const std::string& file, const std::string& now,
                       const std::string& other) {
  folder.write(file, now);
  const auto before = hash_of_scene_inputs(scene);
  ASSERT_TRUE(before) << scene;
  folder.write(file, other);
  EXPECT_NE(hash_of_scene_inputs(scene), before) << file;
  folder.write(file, now);
  EXPECT_EQ(hash_of_scene_inputs(scene), before) << file;
}

TEST(SceneInputs, EveryFileOfASceneCounts) {
  const TempFolder folder;
  const std::string obj = folder.write("room.obj", "mtllib paint.mtl\r\nv 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n");
  expect_depends_on(folder, obj, "room.obj", "mtllib paint.mtl\nv 0 0 0\n", "mtllib paint.mtl\nv 0 0 1\n");
  expect_depends_on(folder, obj, "paint.mtl", "newmtl a", "newmtl b");
  expect_depends_on(folder, obj, "room.mtl", "newmtl a", "newmtl b");  // the fallback for a library that is absent

  folder.write("room.obj", "mtllib one.mtl two.mtl\nmtllib\tthree four.mtl\nv 0 0 0\n");
  for (const char* library : {"one.mtl", "two.mtl", "three four.mtl"}) expect_depends_on(folder, obj, library, "newmtl a", "newmtl b");

  const std::string yaml =
      folder.write("scene.yaml", "mesh: room.obj\nmaterials: stuff.json\nsemantics: words.yaml\nair: {temperature_c: 20}\n");
  folder.write("stuff.json", "{}");
  folder.write("words.yaml", "a: b\n");
  expect_depends_on(folder, yaml, "scene.yaml", "mesh: room.obj\nmaterials: stuff.json\nsemantics: words.yaml\n",
                    "mesh: room.obj\nmaterials: stuff.json\nsemantics: words.yaml\nceiling_m: 3\n");
  expect_depends_on(folder, yaml, "room.obj", "v 0 0 0\n", "v 0 0 2\n");
  expect_depends_on(folder, yaml, "stuff.json", "{}", "{ }");
  expect_depends_on(folder, yaml, "words.yaml", "a: b\n", "a: c\n");
  EXPECT_NE(hash_of_scene_inputs(obj), hash_of_scene_inputs(yaml));
  std::filesystem::remove(folder / "stuff.json");
  EXPECT_FALSE(hash_of_scene_inputs(yaml));  // load_scene says what is missing
}

TEST(SceneInputs, BuffersOfAGltfCount) {
  const TempFolder folder;
  const std::string gltf = folder.write("room.gltf", R"({"buffers": [{"uri" : "data.bin", "byteLength": 4}]})");
  expect_depends_on(folder, gltf, "data.bin", "abcd", "abce");
  const auto before = hash_of_scene_inputs(gltf);
  folder.write("room.gltf", R"({"buffers": [{"uri": "other.bin", "byteLength": 4}]})");
  EXPECT_NE(hash_of_scene_inputs(gltf), before);
  folder.write("room.gltf", R"({"buffers": [{"uri": "a%20b.bin", "byteLength": 4}]})");
  EXPECT_FALSE(hash_of_scene_inputs(gltf));  // another name than it says
  folder.write("room.gltf", R"({"buffers": [{"uri": "data:;base64,AAAA", "byteLength": 3}], "images": [{"uri": "wall.png"}]})");
  folder.write("wall.png", "picture");
  const auto with_picture = hash_of_scene_inputs(gltf);
  ASSERT_TRUE(with_picture);
  folder.write("wall.png", "another picture");
  EXPECT_NE(hash_of_scene_inputs(gltf), with_picture);
}

}  // namespace
}  // namespace earshot
