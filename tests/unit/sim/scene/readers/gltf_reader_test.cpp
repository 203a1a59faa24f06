// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <glm/geometric.hpp>

#include "sim/base/errors.h"
#include "sim/base/text/json.h"
#include "sim/scene/readers/mesh_import.h"
#include "tests/support/files/gltf_files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

/// One triangle (0,0,0) (1,0,0) (0,1,0) in mesh 0, material "Walls/Brick".
GltfWriter one_triangle() {
  GltfWriter file;
  const std::size_t positions = file.add_positions({0, 0, 0, 1, 0, 0, 0, 1, 0});
  file.json["materials"] = {{{"name", "Walls/Brick"}}};
  file.json["meshes"] = {{{"name", "tri"}, {"primitives", {{{"attributes", {{"POSITION", positions}}}, {"material", 0}}}}}};
  file.json["nodes"] = {{{"name", "corner"}, {"mesh", 0}}};
  return file;
}

TriangleMesh import(const std::string& bytes, const std::string& name = "a.gltf") {
  const TempFolder folder;
  return import_mesh(folder.write(name, bytes)).mesh;
}

std::string error_of(const std::string& bytes, const std::string& name = "a.gltf") {
  return message_of<InputError>([&] { import(bytes, name); });
}

void expect_triangle(const TriangleMesh& mesh, std::size_t t, glm::vec3 a, glm::vec3 b, glm::vec3 c) {
  ASSERT_LT(t, mesh.triangles.size());
  const glm::vec3 wanted[3] = {a, b, c};
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(glm::length(mesh.vertices[mesh.triangles[t][i]] - wanted[i]), 1e-6f) << "triangle " << t << ", corner " << i;
  }
}

TEST(GltfReader, ReadsGltfAndGlbAlikeAndKeepsNames) {
  for (const TriangleMesh& mesh : {import(one_triangle().gltf()), import(one_triangle().glb(), "a.GLB")}) {
    ASSERT_EQ(mesh.triangles.size(), 1u);
    expect_triangle(mesh, 0, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
    EXPECT_EQ(mesh.material_names, std::vector<std::string>{"Walls/Brick"});
    EXPECT_EQ(mesh.object_names, std::vector<std::string>{"corner"});
  }
}

// Parent: quarter turn about y, then 10 along x.  Child: scale (2, 3, 4), then 1 along z.
TEST(GltfReader, BakesNestedTransforms) {
  GltfWriter file = one_triangle();
  const double h = std::sqrt(0.5);
  file.json["nodes"] = {{{"name", "parent"}, {"rotation", {0, h, 0, h}}, {"translation", {10, 0, 0}}, {"children", {1, 2}}},
                        {{"name", "child"}, {"mesh", 0}, {"scale", {2, 3, 4}}, {"translation", {0, 0, 1}}},
                        {{"mesh", 0}, {"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1}}}};
  file.json["scenes"] = {{{"nodes", {0}}}};
  const TriangleMesh mesh = import(file.gltf());
  ASSERT_EQ(mesh.triangles.size(), 2u);
  // About y by +90 degrees: (x, y, z) -> (z, y, -x).
  expect_triangle(mesh, 0, {11, 0, 0}, {11, 0, -2}, {11, 3, 0});
  expect_triangle(mesh, 1, {17, 6, -5}, {17, 6, -6}, {17, 7, -5});
  EXPECT_EQ(mesh.object_names, (std::vector<std::string>{"child", "tri"})) << "a node without a name takes the mesh's";
  EXPECT_EQ(mesh.material_names.size(), 1u);
}

TEST(GltfReader, OnlyTheDefaultSceneCounts) {
  GltfWriter file = one_triangle();
  file.json["nodes"].push_back({{"name", "other"}, {"mesh", 0}, {"translation", {5, 0, 0}}});
  file.json["scenes"] = {{{"nodes", {0}}}, {{"nodes", {1}}}};
  file.json["scene"] = 1;
  EXPECT_EQ(import(file.gltf()).object_names, std::vector<std::string>{"other"});
  file.json.erase("scenes");
  file.json.erase("scene");
  EXPECT_EQ(import(file.gltf()).triangles.size(), 2u) << "without scenes all roots are read";
}

TEST(GltfReader, ReadsEveryIndexTypeStripsAndFans) {
  const std::vector<float> square{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
  for (const int type : {5121, 5123, 5125}) {
    GltfWriter file = one_triangle();
    const std::size_t positions = file.add_positions(square);
    const std::size_t view = type == 5121   ? file.add_view(std::vector<std::uint8_t>{0, 1, 2, 1, 3, 2})
                             : type == 5123 ? file.add_view(std::vector<std::uint16_t>{0, 1, 2, 1, 3, 2})
                                            : file.add_view(std::vector<std::uint32_t>{0, 1, 2, 1, 3, 2});
    file.json["meshes"][0]["primitives"][0] = {{"attributes", {{"POSITION", positions}}},
                                               {"indices", file.add_accessor(view, 6, type, "SCALAR")}};
    const TriangleMesh mesh = import(file.gltf());
    ASSERT_EQ(mesh.triangles.size(), 2u) << type;
    expect_triangle(mesh, 1, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
    EXPECT_EQ(mesh.material_names, std::vector<std::string>{"default"});
  }
  // glTF 2.0, 3.7.2.1: strip (i, i + 1 + i % 2, i + 2 - i % 2), fan (i + 1, i + 2, 0).
  GltfWriter strip = one_triangle();
  strip.json["meshes"][0]["primitives"][0] = {{"attributes", {{"POSITION", strip.add_positions(square)}}}, {"mode", 5}};
  expect_triangle(import(strip.gltf()), 1, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  GltfWriter fan = one_triangle();
  fan.json["meshes"][0]["primitives"][0] = {{"attributes", {{"POSITION", fan.add_positions(square)}}}, {"mode", 6}};
  expect_triangle(import(fan.gltf()), 0, {1, 0, 0}, {0, 1, 0}, {0, 0, 0});
  GltfWriter lines = one_triangle();
  lines.json["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", lines.add_positions(square)}}}, {"mode", 1}});
  EXPECT_EQ(import(lines.gltf()).triangles.size(), 1u) << "lines are dropped";
}

// The last element of an interleaved accessor ends before a whole stride does.
TEST(GltfReader, ReadsInterleavedAccessors) {
  GltfWriter file = one_triangle();
  const std::size_t view = file.add_view(std::vector<float>{9, 9, 0, 0, 0, 9, 9, 2, 0, 0, 9, 9, 0, 2, 0}, 20);
  const std::size_t positions = file.add_accessor(view, 3, 5126, "VEC3");
  file.json["accessors"][positions]["byteOffset"] = 8;
  file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = positions;
  expect_triangle(import(file.gltf()), 0, {0, 0, 0}, {2, 0, 0}, {0, 2, 0});
}

TEST(GltfReader, ReadsSparseAndQuantizedPositions) {
  GltfWriter file = one_triangle();
  const std::size_t places = file.add_view(std::vector<std::uint16_t>{1}), news = file.add_view(std::vector<float>{7, 8, 9});
  file.json["accessors"][0]["sparse"] = {
      {"count", 1}, {"indices", {{"bufferView", places}, {"componentType", 5123}}}, {"values", {{"bufferView", news}}}};
  expect_triangle(import(file.gltf()), 0, {0, 0, 0}, {7, 8, 9}, {0, 1, 0});

  GltfWriter quantized = one_triangle();  // a stride of 8: three shorts and a pad
  const std::size_t view = quantized.add_view(std::vector<std::int16_t>{0, 0, 0, 0, 32767, 0, -32767, 0, 0, 16384, 0, 0}, 8);
  const std::size_t positions = quantized.add_accessor(view, 3, 5122, "VEC3");
  quantized.json["accessors"][positions]["normalized"] = true;
  quantized.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = positions;
  const TriangleMesh mesh = import(quantized.gltf());
  EXPECT_LT(glm::length(mesh.vertices[mesh.triangles[0].y] - glm::vec3(1, 0, -1)), 1e-6f);
  EXPECT_NEAR(mesh.vertices[mesh.triangles[0].z].y, 16384.f / 32767, 1e-6f);
}

TEST(GltfReader, RefusesBrokenFilesInOneLine) {
  const auto changed = [](auto change) {
    GltfWriter file = one_triangle();
    change(file.json);
    return error_of(file.gltf());
  };
  EXPECT_THAT(error_of("{"), HasSubstr("JSON error at byte"));
  EXPECT_THAT(error_of("[]"), HasSubstr("asset"));
  EXPECT_THAT(error_of(R"({"asset": {"version": "1.0"}})"), HasSubstr("version"));
  EXPECT_THAT(error_of(R"({"asset": {"version": "2.0"}})"), HasSubstr("no triangles"));
  EXPECT_THAT(error_of(one_triangle().glb().substr(0, 60), "a.glb"), HasSubstr("GLB"));
  EXPECT_THAT(changed([](Json& j) { j["accessors"][0]["count"] = 4; }), HasSubstr("exceeds its buffer view"));
  EXPECT_THAT(changed([](Json& j) { j["accessors"][0]["count"] = 0xFFFFFFFFFFFFull; }), HasSubstr("elements"));
  EXPECT_THAT(changed([](Json& j) { j["accessors"][0]["byteOffset"] = -4; }), HasSubstr("byteOffset"));
  EXPECT_THAT(changed([](Json& j) { j["bufferViews"][0]["byteLength"] = 1000; }), HasSubstr("exceeds its buffer"));
  EXPECT_THAT(changed([](Json& j) { j["accessors"][0]["componentType"] = 5130; }), HasSubstr("5130"));
  EXPECT_THAT(changed([](Json& j) { j["accessors"][0].erase("bufferView"); }), HasSubstr("no data"));
  EXPECT_THAT(changed([](Json& j) { j["nodes"][0]["mesh"] = 3; }), HasSubstr("not valid glTF"));
  EXPECT_THAT(changed([](Json& j) { j["nodes"][0]["children"] = {0}; }), HasSubstr("no triangles")) << "its own child: no root";
  EXPECT_THAT(changed([](Json& j) {
                j["nodes"][0]["children"] = {0};
                j["scenes"] = {{{"nodes", {0}}}};
              }),
              HasSubstr("two parents"));
  EXPECT_THAT(changed([](Json& j) { j["nodes"][0]["matrix"] = {1, 2, 3}; }), HasSubstr("not valid glTF"));
  EXPECT_THAT(changed([](Json& j) { j["nodes"][0]["scale"] = {1e38, 1e38, 1e38}; }), HasSubstr("not finite"));
  EXPECT_THAT(changed([](Json& j) { j["extensionsRequired"] = {"KHR_draco_mesh_compression"}; }), HasSubstr("KHR_draco_mesh_compression"));
  EXPECT_THAT(changed([](Json& j) { j["meshes"] = 5; }), HasSubstr("'meshes' is not a list"));
  GltfWriter external = one_triangle();
  external.json["buffers"] = {{{"byteLength", 36}, {"uri", "gone.bin"}}};
  EXPECT_THAT(error_of(json_text(external.json)), HasSubstr("gone.bin"));
}

TEST(GltfReader, NamesTheVertexThatIsNotANumber) {
  GltfWriter file = one_triangle();
  const std::size_t positions = file.add_positions({0, 0, 0, 1, 0, 0, 0, std::numeric_limits<float>::quiet_NaN(), 0});
  file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = positions;
  EXPECT_THAT(error_of(file.gltf()), HasSubstr("vertex 2 of 'corner' is not finite"));
  GltfWriter far = one_triangle();
  far.json["meshes"][0]["primitives"][0]["indices"] =
      far.add_accessor(far.add_view(std::vector<std::uint16_t>{0, 1, 3}), 3, 5123, "SCALAR");
  EXPECT_THAT(error_of(far.gltf()), HasSubstr("uses vertex 3, but there are 3 vertices"));
}

TEST(GltfReader, ReadsBuffersBesideTheFile) {
  const TempFolder folder;
  GltfWriter file = one_triangle();
  file.json["buffers"] = {{{"byteLength", file.bytes.size()}, {"uri", "my%20data.bin"}}};
  folder.write("my data.bin", file.bytes);
  EXPECT_EQ(import_mesh(folder.write("a.gltf", json_text(file.json))).mesh.triangles.size(), 1u);
}

}  // namespace
}  // namespace earshot
