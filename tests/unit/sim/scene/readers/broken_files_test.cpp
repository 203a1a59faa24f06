// SPDX-License-Identifier: Apache-2.0
// Damaged files: every truncation and every flipped byte must load or throw InputError, in bounded time and memory.
#include <gtest/gtest.h>

#include <functional>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/scene/materials/materials.h"
#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/scene.h"
#include "tests/support/files/gltf_files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

/// One third truncated, the rest with 1 to 8 bytes changed, half of them near the start, where headers are.
std::string damaged(const std::string& original, std::uint32_t round) {
  const RandomStream random(11, Purpose::test, round);
  std::string bytes = original;
  if (round % 3 == 0) {
    bytes.resize(random.below(static_cast<std::uint32_t>(bytes.size()), 0));
    return bytes;
  }
  const std::uint32_t changes = 1 + random.below(8, 1);
  const std::size_t reach = round % 2 ? bytes.size() : std::min<std::size_t>(bytes.size(), 400);
  for (std::uint32_t i = 0; i < changes; ++i) {
    bytes[random.below(static_cast<std::uint32_t>(reach), 2 + 2 * i)] = static_cast<char>(random.bits(3 + 2 * i) & 0xFFu);
  }
  return bytes;
}

/// A file of its own per round: overwriting one makes some file systems write through.
void expect_survival(const std::string& original, std::uint32_t rounds,
                     const std::function<void(const std::string&, const std::string&)>& load) {
  std::uint32_t loaded = 0, refused = 0;
  for (std::uint32_t round = 0; round < rounds; ++round) {
    try {
      load(std::to_string(round), damaged(original, round));
      ++loaded;
    } catch (const InputError& error) {
      ++refused;
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    }  // any other exception fails the test
  }
  EXPECT_GT(refused, 0u);
  EXPECT_EQ(loaded + refused, rounds);
}

void expect_mesh_survival(const std::string& name, const std::string& original, std::uint32_t rounds = 300) {
  const TempFolder folder;
  expect_survival(original, rounds,
                  [&](const std::string& round, const std::string& bytes) { import_mesh(folder.write(round + name, bytes)); });
}

GltfWriter two_boxes() {
  GltfWriter file;
  const std::size_t positions = file.add_positions({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 1, 0, 1});
  const std::size_t indices = file.add_accessor(file.add_view(std::vector<std::uint16_t>{0, 1, 2, 1, 3, 2, 0, 4, 5}), 9, 5123, "SCALAR");
  file.json["materials"] = {{{"name", "wood"}}};
  file.json["meshes"] = {
      {{"name", "m"}, {"primitives", {{{"attributes", {{"POSITION", positions}}}, {"indices", indices}, {"material", 0}}}}}};
  file.json["nodes"] = {{{"name", "a"}, {"mesh", 0}, {"children", {1}}}, {{"name", "b"}, {"mesh", 0}, {"translation", {3, 0, 0}}}};
  file.json["scenes"] = {{{"nodes", {0}}}};
  return file;
}

TEST(BrokenFiles, Gltf) { expect_mesh_survival("a.gltf", two_boxes().gltf(), 600); }
TEST(BrokenFiles, Glb) { expect_mesh_survival("a.glb", two_boxes().glb(), 600); }

TEST(BrokenFiles, Obj) {
  expect_mesh_survival(
      "a.obj",
      "mtllib a.mtl\no box\nusemtl wall\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nvn 0 0 1\nvt 0 0\nf 1/1/1 2/1/1 3/1/1 4/1/1\n"
      "g lid\nusemtl b\nf 1//1 2//1 4//1\nf -1 -2 -3\ns 1\nl 1 2\n");
}

TEST(BrokenFiles, PlyText) {
  expect_mesh_survival(
      "a.ply",
      "ply\nformat ascii 1.0\ncomment c\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 1\n3 0 1 2\n3 0 2 3\n");
}

TEST(BrokenFiles, PlyBinary) {
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
  const float vertices[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const std::int32_t face[3] = {0, 1, 2};
  file.append(reinterpret_cast<const char*>(vertices), sizeof vertices);
  file.push_back(3);
  file.append(reinterpret_cast<const char*>(face), sizeof face);
  expect_mesh_survival("a.ply", file);
}

TEST(BrokenFiles, StlText) {
  expect_mesh_survival("a.stl",
                       "solid wedge\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 3 0 0\nvertex 0 4 0\nendloop\nendfacet\n"
                       "facet normal 0 0 1\nouter loop\nvertex 3 0 0\nvertex 3 4 0\nvertex 0 4 0\nendloop\nendfacet\nendsolid wedge\n");
}

TEST(BrokenFiles, StlBinary) {
  std::string file(80, 'h');
  const std::uint32_t count = 2;
  const float facet[12] = {0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 4, 0};
  file.append(reinterpret_cast<const char*>(&count), 4);
  for (int i = 0; i < 2; ++i) {
    file.append(reinterpret_cast<const char*>(facet), sizeof facet);
    file.append(2, '\0');
  }
  expect_mesh_survival("a.stl", file);
}

TEST(BrokenFiles, SharedMeshes) {
  SKIP_WITHOUT_DATA("meshes_hard/unit_cube.STL");
  for (const char* name : {"scenes/formats/transform_box.glb", "scenes/formats/cornell_box.obj", "meshes_hard/unit_cube.STL",
                           "meshes_hard/multibody.stl", "meshes_hard/wallhole.obj"}) {
    std::ifstream stream(data_folder() / name, std::ios::binary);
    const std::string original{std::istreambuf_iterator<char>(stream), {}};
    expect_mesh_survival("a" + std::filesystem::path(name).extension().string(), original, 150);
  }
}

TEST(BrokenFiles, SceneYaml) {
  const TempFolder folder;
  folder.write("m.obj", "o box\nusemtl wall\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3 4\n");
  const std::string yaml =
      "mesh: m.obj\nup: z\nunit_m: 0.5\nceiling_m: 3\nassign:\n  wall: gypsum_board\n  \"b*\": wood_door\ndefault_material: default\n"
      "air: {temperature_c: 21, humidity_percent: 40, pressure_kpa: 100}\ntwo_sided: true\n";
  ASSERT_NO_THROW(load_scene(folder.write("s.yaml", yaml)));
  expect_survival(yaml, 400, [&](const std::string& round, const std::string& bytes) { load_scene(folder.write(round + ".yaml", bytes)); });
}

TEST(BrokenFiles, MaterialJson) {
  const std::string json =
      R"({"materials": [{"name": "a", "labels": ["wall"], "absorption": [125, 0.1, 4000, 0.2], "scattering": [125, 0.1], "transmission": [125, 0.01],
          "damping": [125, 0.0], "speed": 1500.0, "density": 1000, "source": "x"},
         {"name": "default", "labels": ["default"], "absorption": [125, 0.1], "scattering": [125, 0.5]}]})";
  expect_survival(json, 600, [](const std::string&, const std::string& bytes) { MaterialDatabase::from_json(bytes, "db"); });
}

}  // namespace
}  // namespace earshot
