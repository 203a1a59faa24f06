// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/mesh_import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <glm/geometric.hpp>

#include "sim/base/errors.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

double area_of(const TriangleMesh& mesh) {
  double area = 0;
  for (const glm::uvec3 t : mesh.triangles) {
    const glm::dvec3 a = mesh.vertices[t.x], b = mesh.vertices[t.y], c = mesh.vertices[t.z];
    area += glm::length(glm::cross(b - a, c - a)) / 2;
  }
  return area;
}

/// A box of 1 x 2 x 3 with a corner at the origin, quads, two objects and two materials.
const char* const box_obj =
    "# a box\n"
    "v 0 0 0\nv 1 0 0\nv 1 2 0\nv 0 2 0\nv 0 0 3\nv 1 0 3\nv 1 2 3\nv 0 2 3\n"
    "o sides\nusemtl Brick/Rough #1\n"
    "f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 4 3 7 8\n"
    "o ends\nusemtl paint\n"
    "f 1 4 8 5\nf 2 6 7 3\n";

ImportedMesh import_file(const std::string& name, std::string_view bytes, const MeshImportOptions& options = {}) {
  const TempFolder folder;
  return import_mesh(folder.write(name, bytes), options);
}

std::string file_error_of(const std::string& name, std::string_view bytes) {
  return message_of<InputError>([&] { import_file(name, bytes); });
}

std::string crlf(std::string text) {
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.replace(at, 1, "\r\n");
  return text;
}

TEST(MeshImport, ObjKeepsNamesAndCutsQuads) {
  for (const std::string& text : {std::string(box_obj), crlf(box_obj), "\xEF\xBB\xBF" + std::string(box_obj)}) {
    const ImportedMesh imported = import_file("box.obj", text);
    EXPECT_EQ(imported.mesh.triangles.size(), 12u);
    EXPECT_EQ(imported.mesh.vertices.size(), 8u);
    EXPECT_EQ(imported.report.triangles_read, 12u);
    EXPECT_NEAR(area_of(imported.mesh), 2 * (1 * 2 + 2 * 3 + 1 * 3), 1e-5);
    EXPECT_THAT(imported.mesh.material_names, testing::UnorderedElementsAre("Brick/Rough #1", "paint"));
    EXPECT_THAT(imported.mesh.object_names, testing::UnorderedElementsAre("sides", "ends"));
    for (std::size_t t = 0; t < 12; ++t) {
      const bool sides = imported.mesh.object_names[imported.mesh.triangle_object[t]] == "sides";
      EXPECT_EQ(imported.mesh.material_names[imported.mesh.triangle_material[t]], sides ? "Brick/Rough #1" : "paint");
    }
    EXPECT_TRUE(imported.report.warnings.empty());
  }
}

TEST(MeshImport, TurnsZUpAndScales) {
  const ImportedMesh imported =
      import_file("a.obj", "v 100 200 300\nv 200 200 300\nv 100 300 400\nf 1 2 3\n", {MeshImportOptions::Up::z, 0.01f});
  const glm::uvec3 t = imported.mesh.triangles[0];
  EXPECT_LT(glm::length(imported.mesh.vertices[t.x] - glm::vec3(1, 3, -2)), 1e-6f) << "(x, y, z) -> (x, z, -y)";
  EXPECT_LT(glm::length(imported.mesh.vertices[t.y] - glm::vec3(2, 3, -2)), 1e-6f);
  EXPECT_LT(glm::length(imported.mesh.vertices[t.z] - glm::vec3(1, 4, -3)), 1e-6f);
}

TEST(MeshImport, ReadsPlyInAllEncodings) {
  const auto header = [](const std::string& format) {
    return "ply\nformat " + format +
           " 1.0\ncomment by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
           "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
  };
  const float vertices[12] = {0, 0, 0, 2, 0, 0, 2, 2, 0, 0, 2, 2};
  const std::int32_t faces[2][3] = {{0, 1, 2}, {0, 2, 3}};
  std::string little, big;
  const auto append = [&](const void* value) {
    const char* bytes = static_cast<const char*>(value);
    little.append(bytes, 4);
    for (int i = 3; i >= 0; --i) big.push_back(bytes[i]);
  };
  for (const float& value : vertices) append(&value);
  for (const auto& face : faces) {
    little.push_back(3);
    big.push_back(3);
    for (const std::int32_t& index : face) append(&index);
  }
  const std::string ascii = "0 0 0\n2 0 0\n2 2 0\n0 2 2\n3 0 1 2\n3 0 2 3\n";
  const double expected = 2 + std::sqrt(3.) * 2;  // a right triangle; an equilateral one of side 2 sqrt 2
  for (const std::string& file : {header("ascii") + ascii, crlf(header("ascii") + ascii), header("binary_little_endian") + little,
                                  header("binary_big_endian") + big}) {
    const ImportedMesh imported = import_file("a.ply", file);
    EXPECT_EQ(imported.mesh.triangles.size(), 2u);
    EXPECT_EQ(imported.mesh.vertices.size(), 4u);
    EXPECT_NEAR(area_of(imported.mesh), expected, 1e-5);
  }
}

TEST(MeshImport, ReadsStlTextAndBinary) {
  const std::string text =
      "solid wedge\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 3 0 0\nvertex 0 4 0\nendloop\nendfacet\n"
      "facet normal 0 0 1\nouter loop\nvertex 3 0 0\nvertex 3 4 0\nvertex 0 4 0\nendloop\nendfacet\nendsolid wedge\n";
  const float facets[2][12] = {{0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 4, 0}, {0, 0, 1, 3, 0, 0, 3, 4, 0, 0, 4, 0}};
  std::string binary(80, '\0');
  const std::uint32_t count = 2;
  binary.append(reinterpret_cast<const char*>(&count), 4);
  for (const auto& facet : facets) {
    binary.append(reinterpret_cast<const char*>(facet), sizeof facet);
    binary.append(2, '\0');
  }
  for (const std::string& file : {text, binary}) {
    const ImportedMesh imported = import_file("a.STL", file);
    EXPECT_EQ(imported.mesh.triangles.size(), 2u);
    EXPECT_EQ(imported.mesh.vertices.size(), 4u) << "corners of facets are welded";
    EXPECT_NEAR(area_of(imported.mesh), 12, 1e-5);
    EXPECT_FALSE(imported.mesh.object_names[0].empty());
  }
}

TEST(MeshImport, CountsWhatItRepairs) {
  const ImportedMesh imported = import_file("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 3 2 1\nf 1 2 4\nf 1 1 2\n");
  EXPECT_EQ(imported.report.triangles_read, 4u);
  EXPECT_EQ(imported.report.duplicate_removed, 1u);
  EXPECT_EQ(imported.report.degenerate_removed, 2u);
  EXPECT_EQ(imported.mesh.triangles.size(), 1u);
}

// docs/evidence/stability.md, H-12.
TEST(MeshImport, WarnsAboutSuspiciousSizes) {
  const auto warnings = [](const char* text) { return import_file("a.obj", text).report.warnings; };
  EXPECT_THAT(warnings("v 0 0 0\nv 501 0 0\nv 0 1 0\nf 1 2 3\n"), testing::ElementsAre(HasSubstr("501 m")));
  EXPECT_THAT(warnings("v 0 0 0\nv 0.4 0 0\nv 0 0.3 0\nf 1 2 3\n"), testing::ElementsAre(HasSubstr("0.4 m")));
  EXPECT_TRUE(warnings("v 1e6 0 0\nv 1000005 0 0\nv 1e6 5 0\nf 1 2 3\n").empty()) << "far from the origin is handled: H9_FarFromTheOrigin";
  EXPECT_TRUE(warnings("v 0 0 0\nv 5 0 0\nv 0 5 0\nf 1 2 3\n").empty());
}

TEST(MeshImport, RefusesBadFilesInOneLine) {
  EXPECT_THAT(message_of<InputError>([] { import_mesh("no/such/mesh.glb"); }), HasSubstr("does not exist"));
  EXPECT_THAT(message_of<InputError>([] { import_mesh("."); }), HasSubstr("not a file"));
  EXPECT_THAT(file_error_of("a.off", "OFF\n"), HasSubstr("extension"));
  EXPECT_THAT(file_error_of("a.obj", ""), HasSubstr("a.obj"));
  EXPECT_THAT(file_error_of("a.obj", "v 0 0 0\n"), HasSubstr("a.obj"));
  EXPECT_THAT(file_error_of("a.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), HasSubstr("no triangle with an area"));
  EXPECT_THAT(file_error_of("a.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n"), AllOf(HasSubstr("vertex 1"), HasSubstr("not finite")));
  EXPECT_THAT(file_error_of("a.obj", "v 0 0 0\nv 1 0 0\nv 0 inf 0\nf 1 2 3\n"), AllOf(HasSubstr("vertex 2"), HasSubstr("not finite")));
  EXPECT_NE(file_error_of("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n"), "") << "index out of range";
  EXPECT_THAT(file_error_of("a.obj", "usemtl " + std::string(5000, 'n') + "\nv 0 0 0\n"), HasSubstr("5000 bytes"));
  EXPECT_NE(file_error_of("a.stl", "solid x\n"), "");
  EXPECT_NE(file_error_of("a.stl", std::string(200, 'x')), "");
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\n";
  EXPECT_THAT(file_error_of("a.ply", ply), HasSubstr("end_header"));
  EXPECT_THAT(file_error_of("a.ply", ply + "end_header\n0 0 0\n"), HasSubstr("declares"));
  EXPECT_THAT(file_error_of("a.ply", "ply\nformat ascii 1.0\nelement vertex 99999999999999\nproperty float x\nend_header\n0\n"),
              HasSubstr("declares"));
  EXPECT_THAT(file_error_of("a.ply", "ply\nformat ascii 1.0\nelement vertex three\nend_header\n0\n"), HasSubstr("line 3"));
  EXPECT_NE(file_error_of("a.ply", ply + "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n"), "") << "index out of range";
  for (const char* name : {"a.glb", "a.gltf", "a.obj", "a.ply", "a.stl"}) {
    EXPECT_THAT(file_error_of(name, "\x01\x02garbage\n\n\xFF"), AllOf(HasSubstr(name), Not(HasSubstr("\n")))) << name;
  }
}

// Each line of a long continuation is looked at from its end: half a million of them take a moment.
TEST(MeshImport, LongContinuationsAndBlanksBeforeATextAreRead) {
  const std::string triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n";
  std::string lines;
  for (int i = 0; i < 500'000; ++i) lines += "\\\n";
  const TempFolder folder;
  EXPECT_EQ(import_mesh(folder.write("a.obj", triangle + lines + "3\n")).mesh.triangles.size(), 1u);
  const std::string facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
  EXPECT_EQ(import_mesh(folder.write("a.stl", "\n \r\nsolid room\n" + facet + "endsolid room\n")).mesh.triangles.size(), 1u);
}

struct Known {
  const char* file;
  std::uint64_t triangles;
  std::size_t materials;
  glm::vec3 lower, upper;
};

// Triangle counts are those of the files' own headers; bounds as Assimp 5.2 bakes them.
TEST(MeshImport, ReadsTheSharedScenes) {
  SKIP_WITHOUT_DATA("scenes");
  const std::vector<Known> known{
      {"small_house.glb", 145844, 62, {-9.5f, 0, -5.7f}, {9.5f, 3, 5.7f}},
      {"bathroom.glb", 380280, 30, {-2.66f, -0.01f, -2.5f}, {2.5f, 2.79f, -0.05f}},
      {"garage/garage.gltf", 11358, 17, {-3.43f, -0.05f, -3.48f}, {3.35f, 2.93f, 4.07f}},
      {"home-theater/home-theater.gltf", 7915, 20, {-3.02f, -1.52f, -4.52f}, {3.05f, 1.8f, 2.59f}},
      {"cube-room/cube-room.gltf", 5364, 1, {-5, 0, -5}, {5, 7, 5}},
      {"formats/transform_box.glb", 12, 3, {-1, -1, -1}, {1, 1, 1}},
      {"formats/nested_box.glb", 24, 2, {-0.52f, -0.32f, -0.44f}, {0.52f, 0.32f, 0.44f}},
      {"formats/cornell_box.obj", 34, 3, {0, 0, 0}, {556, 548.8f, 559.2f}},
      {"formats/batch-four-squares-deep-hierarchy-whole-file.gltf", 8, 4, {-0.9f, -0.9f, 0}, {0.9f, 0.9f, 0}},
  };
  for (const Known& k : known) {
    const ImportedMesh imported = import_mesh(data_folder() / "scenes" / k.file);
    const Bounds bounds = bounds_of(imported.mesh);
    EXPECT_EQ(imported.report.triangles_read, k.triangles) << k.file;
    EXPECT_EQ(imported.mesh.triangles.size() + imported.report.degenerate_removed + imported.report.duplicate_removed, k.triangles)
        << k.file;
    EXPECT_EQ(imported.mesh.material_names.size(), k.materials) << k.file;
    EXPECT_LT(glm::length(bounds.lower - k.lower), 0.01f) << k.file;
    EXPECT_LT(glm::length(bounds.upper - k.upper), 0.01f) << k.file;
  }
  const ImportedMesh house = import_mesh(data_folder() / "scenes/small_house.glb");
  EXPECT_THAT(house.mesh.material_names, testing::Contains("Bed/Material #3"));
  EXPECT_THAT(house.mesh.object_names, testing::Contains("SofaC_01_001"));
}

TEST(MeshImport, HardFilesLoadOrGiveOneLine) {
  SKIP_WITHOUT_DATA("meshes_hard");
  int loaded = 0;
  for (const char* folder : {"meshes_hard", "scenes/formats"}) {
    for (const auto& entry : std::filesystem::directory_iterator(data_folder() / folder)) {
      const std::string message = message_of<InputError>([&] {
        const ImportedMesh imported = import_mesh(entry.path());
        loaded += !imported.mesh.triangles.empty();
      });
      EXPECT_THAT(message, Not(HasSubstr("\n"))) << entry.path();
    }
  }
  EXPECT_GE(loaded, 20);
  for (const char* must_load : {"featuretype.STL", "groups.obj", "large_block.STL", "multibody.stl", "nancolor.obj", "not_convex.obj",
                                "soup.stl", "tube.obj", "unit_cube.STL", "wallhole.obj"}) {
    EXPECT_NO_THROW(import_mesh(data_folder() / "meshes_hard" / must_load)) << must_load;
  }
}

}  // namespace
}  // namespace earshot
