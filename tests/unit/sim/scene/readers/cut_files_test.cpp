// SPDX-License-Identifier: Apache-2.0
// A mesh file that ends too early is refused or read whole, in every format and encoding.
//
// Three cuts cannot be told from a whole file, and none of them passes without a word:
// - an OBJ and a text STL that end between two faces are files of fewer faces.  The STL lacks its endsolid, which is a warning; the OBJ has
//   vertices that no face uses, which is a warning too, unless the cut is so late that every vertex is used.
// - an OBJ or a text PLY that ends within or right behind the last digits of a line is complete to its last number, and whole files without
//   a line break at their end are common.  It is read with a warning where no vertex is left unused.
#include <gtest/gtest.h>

#include <set>

#include "sim/base/errors.h"
#include "sim/scene/readers/mesh_import.h"
#include "tests/support/files/random_rooms.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using random_rooms::Draws;
using random_rooms::Room;

/// Triangles as sets of corners: independent of their order.
std::multiset<std::string> triangles_of(const TriangleMesh& mesh) {
  std::multiset<std::string> found;
  for (const glm::uvec3 t : mesh.triangles) {
    std::multiset<std::string> corners;
    for (int c = 0; c < 3; ++c)
      corners.insert(fmt::format("{} {} {}", mesh.vertices[t[c]].x, mesh.vertices[t[c]].y, mesh.vertices[t[c]].z));
    found.insert(fmt::format("{}", fmt::join(corners, ";")));
  }
  return found;
}

bool has_word_of_cut(const ImportReport& report) {
  for (const std::string& warning : report.warnings)
    if (warning.find("the file is complete") != std::string::npos) return true;
  return false;
}

enum class CutTold { always, unless_between_faces };

/// Twenty cuts of each of ten rooms.
void expect_cuts_are_seen(std::uint32_t test, const std::string& name, CutTold told,
                          const std::function<std::string(const Room&)>& bytes_of) {
  int refused = 0, named = 0, between_faces = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    Draws draws(test, number);
    const Room room = random_rooms::room(draws);
    const std::string whole = bytes_of(room);
    const TempFolder folder;
    const auto expected = triangles_of(import_mesh(folder.write("whole_" + name, whole)).mesh);
    ASSERT_EQ(expected.size(), 12u);
    for (int cut = 0; cut < 20; ++cut) {
      const std::size_t size = draws.below(whole.size());
      const std::string file = folder.write(fmt::format("{}_{}", cut, name), whole.substr(0, size));
      try {
        const ImportedMesh imported = import_mesh(file);
        if (triangles_of(imported.mesh) == expected) continue;
        const bool is_between_lines = size > 0 && (whole[size - 1] == '\n' || whole[size] == '\n');
        if (has_word_of_cut(imported.report)) {
          ++named;
          // Named, not refused, where the last line is complete alone.
          EXPECT_TRUE(is_between_lines || told == CutTold::unless_between_faces) << name << ": " << whole.substr(0, size);
        } else {
          EXPECT_TRUE(told == CutTold::unless_between_faces && is_between_lines) << name << ": " << whole.substr(0, size);
          ++between_faces;
        }
      } catch (const InputError& error) {
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
        ++refused;
      }
    }
  }
  testing::Test::RecordProperty(name + "_refused", refused);
  EXPECT_GE(refused, 150) << name << ": named " << named << ", between faces " << between_faces;
  EXPECT_TRUE(told == CutTold::unless_between_faces || between_faces == 0);
}

TEST(CutFiles, Obj) {
  expect_cuts_are_seen(41, "a.obj", CutTold::unless_between_faces, [](const Room& room) { return mesh_cases::obj_text(room.mesh); });
}

// Faces of many digits and forms, so that most cuts are within a line.
TEST(CutFiles, ObjWithLongLines) {
  expect_cuts_are_seen(42, "b.obj", CutTold::unless_between_faces, [](const Room& room) {
    std::string text;
    for (int i = 0; i < 100; ++i) text += "vn 0 1 0\nvt 0.25 0.75\n";
    for (const glm::dvec3 v : room.mesh.vertices) text += fmt::format("v {:.6f} {:.6f} {:.6f} 1 1 1\n", v.x, v.y, v.z);
    for (const glm::uvec3 t : room.mesh.triangles) text += fmt::format("f {0}/77/88 {1}/7/99 {2}/71/23\n", t.x + 1, t.y + 1, t.z + 1);
    return text;
  });
}

TEST(CutFiles, Ply) {
  using mesh_cases::PlyBody;
  std::uint32_t test = 43;
  for (const PlyBody body : {PlyBody::text, PlyBody::floats, PlyBody::floats_big_endian, PlyBody::doubles, PlyBody::doubles_big_endian}) {
    expect_cuts_are_seen(test++, "a.ply", CutTold::always, [&](const Room& room) { return mesh_cases::ply_file(room.mesh, body); });
  }
}

TEST(CutFiles, StlText) {
  expect_cuts_are_seen(48, "a.stl", CutTold::unless_between_faces, [](const Room& room) { return mesh_cases::stl_text(room.mesh); });
}

TEST(CutFiles, StlBinary) {
  for (const char* header : {"", "solid room"}) {
    expect_cuts_are_seen(49, "b.stl", CutTold::always, [&](const Room& room) {
      return mesh_cases::stl_binary(room.mesh).replace(0, std::string(header).size(), header);
    });
  }
}

TEST(CutFiles, Gltf) {
  expect_cuts_are_seen(50, "a.gltf", CutTold::always, [](const Room& room) { return mesh_cases::gltf_file(room.mesh); });
  expect_cuts_are_seen(51, "a.glb", CutTold::always, [](const Room& room) {
    GltfWriter file;
    std::vector<float> xyz;
    for (const glm::dvec3 v : room.mesh.vertices)
      for (int axis = 0; axis < 3; ++axis) xyz.push_back(static_cast<float>(v[axis]));
    std::vector<std::uint8_t> corners;
    for (const glm::uvec3 t : room.mesh.triangles)
      for (int c = 0; c < 3; ++c) corners.push_back(static_cast<std::uint8_t>(t[c]));
    const std::size_t positions = file.add_positions(xyz), indices = file.add_accessor(file.add_view(corners), 36, 5121, "SCALAR");
    file.json["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", positions}}}, {"indices", indices}}}}}};
    file.json["nodes"] = {{{"mesh", 0}}};
    return file.glb();
  });
}

// The buffer beside a glTF file is cut.
TEST(CutFiles, BufferOfAGltf) {
  for (std::uint32_t number = 0; number < 20; ++number) {
    Draws draws(52, number);
    const Room room = random_rooms::room(draws);
    GltfWriter file;
    std::vector<float> xyz;
    for (const glm::uvec3 t : room.mesh.triangles)
      for (int c = 0; c < 3; ++c)
        for (int axis = 0; axis < 3; ++axis) xyz.push_back(static_cast<float>(room.mesh.vertices[t[c]][axis]));
    file.json["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", file.add_positions(xyz)}}}}}}}};
    file.json["nodes"] = {{{"mesh", 0}}};
    file.json["buffers"] = {{{"byteLength", file.bytes.size()}, {"uri", "a.bin"}}};
    const TempFolder folder;
    const std::string mesh = folder.write("a.gltf", json_text(file.json));
    folder.write("a.bin", file.bytes);
    EXPECT_EQ(import_mesh(mesh).mesh.triangles.size(), 12u);
    folder.write("a.bin", std::string_view(file.bytes).substr(0, draws.below(file.bytes.size())));
    EXPECT_THROW(import_mesh(mesh), InputError);
  }
}

}  // namespace
}  // namespace earshot
