// SPDX-License-Identifier: Apache-2.0
// A mesh with annotations is the mesh whose surfaces are named by hand: the same hash of geometry, names and materials.
#include "sim/scene/annotations/annotated_import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>

#include "sim/base/errors.h"
#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"
#include "sim/scene/scene_image.h"
#include "sim/scene/scene_inputs.h"
#include "tests/support/files/annotated_room.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

std::map<std::string, double> areas_of(const Scene& scene) {
  std::map<std::string, double> areas;
  for (std::uint32_t t = 0; t < scene.mesh().triangles.size(); ++t)
    areas[scene.mesh().material_names[scene.mesh().triangle_material[t]]] += static_cast<double>(scene.triangle_area_m2(t));
  return areas;
}

void expect_areas_of(const Scene& scene, const AnnotatedRoom& room) {
  const std::map<std::string, double> areas = areas_of(scene);
  ASSERT_EQ(areas.size(), room.areas_m2().size());
  for (const auto& [category, area] : room.areas_m2()) EXPECT_NEAR(areas.at(category), area, 1e-4 * area) << category;
}

std::vector<std::uint16_t> categories_seen(const Scene& scene) { return load_appearance(scene)->triangle_category; }

TEST(AnnotatedImport, NumbersOfFacesNameThem) {
  for (std::uint32_t i = 0; i < 6; ++i) {
    const TempFolder folder;
    const AnnotatedRoom room(400 + i, i / 2);
    const bool is_replica = i % 2 == 0;
    folder.write(is_replica ? "mesh_semantic.ply" : "x_semantic.ply", room.ply("object_id", i == 3 ? "short" : "int"));
    folder.write(is_replica ? "info_semantic.json" : "x.house", is_replica ? room.replica_info() : room.house());
    const std::string yaml =
        folder.write("a/scene.yaml", std::string("semantics: indoor\nmesh: ../") + (is_replica ? "mesh" : "x") + "_semantic.ply\n");
    folder.write("b/room.obj", room.obj());
    const Scene annotated = load_scene(yaml), control = load_scene(folder.write("b/scene.yaml", "semantics: indoor\nmesh: room.obj\n"));
    EXPECT_EQ(annotated.hash(), control.hash());
    EXPECT_EQ(annotated.mesh().object_names, control.mesh().object_names);
    EXPECT_EQ(categories_seen(annotated), categories_seen(control));
    EXPECT_EQ(decode_scene(encode_scene(annotated), "image").hash(), annotated.hash());
    expect_areas_of(annotated, room);
    const std::vector<std::string>& warnings = annotated.import_report().warnings;
    EXPECT_EQ(warnings.size(), room.unlabelled_percent() > 0 ? 1u : 0u);
    for (const std::string& warning : warnings)
      EXPECT_THAT(warning, HasSubstr(fmt::format("{:.1f} % of the area ({} of 24 triangles) has no category in", room.unlabelled_percent(),
                                                 i / 2 * 2)));
  }
}

// The room of the field, in Replica's form, is its control: geometry and materials are equal, so the decay is.
TEST(AnnotatedImport, TheRoomOfTheFieldIsItsControl) {
  SKIP_WITHOUT_DATA("field/c13_replica.yaml");
  const Scene replica = load_scene((data_folder() / "field/c13_replica.yaml").string()),
              control = load_scene((data_folder() / "field/c13_control.yaml").string());
  EXPECT_EQ(replica.mesh().vertices, control.mesh().vertices);
  EXPECT_EQ(replica.mesh().triangles, control.mesh().triangles);
  EXPECT_EQ(replica.mesh().triangle_material, control.mesh().triangle_material);
  EXPECT_EQ(replica.mesh().material_names, control.mesh().material_names);
  ASSERT_EQ(replica.materials().size(), control.materials().size());
  for (std::size_t slot = 0; slot < replica.materials().size(); ++slot)
    EXPECT_EQ(replica.materials()[slot].name, control.materials()[slot].name);
  EXPECT_THAT(replica.import_report().warnings, testing::IsEmpty());
  const Scene assigned = load_scene((data_folder() / "field/c13_assign.yaml").string());
  EXPECT_EQ(assigned.materials().at(0).name, "carpet_heavy_on_concrete");
}

// At a vertex of another colour the two others decide.
TEST(AnnotatedImport, TwoOfThreeVerticesDecide) {
  const TempFolder folder;
  const AnnotatedRoom room(420);
  GltfWriter file = room.colored_gltf();
  const auto view = file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].get<std::size_t>();
  const auto offset =
      file.json["bufferViews"][file.json["accessors"][view]["bufferView"].get<std::size_t>()]["byteOffset"].get<std::size_t>();
  for (std::size_t face = 0; face < room.faces.size(); ++face) {
    char& red = file.bytes[offset + 16 * face + 4];  // of its second vertex
    red = static_cast<char>(red ^ 0x55);
  }
  const std::string mesh = folder.write("a.semantic.glb", file.glb());
  folder.write("a.semantic.txt", room.semantic_text());
  expect_areas_of(load_scene(mesh), room);
}

TEST(AnnotatedImport, TheOtherMeshOfThePlaceLendsItsNames) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const TempFolder folder;
    const AnnotatedRoom room(440 + i, i);
    const std::string glb = folder.write("a.basis.glb", room.bare_gltf().glb());
    folder.write("a.semantic.glb", room.colored_gltf().glb());
    folder.write("a.semantic.txt", room.semantic_text());
    expect_areas_of(load_scene(glb), room);
    expect_areas_of(load_scene(folder.write("any.obj", room.obj())), room);
    // Somewhere else nothing is near.
    AnnotatedRoom far_room = room;
    for (glm::dvec3& corner : far_room.corners) corner += glm::dvec3(0.5, 0.25, 0.125);
    const Scene far_scene = load_scene(folder.write("a.basis.glb", far_room.bare_gltf().glb()));
    EXPECT_LT(room.unlabelled_percent(), 50);
    EXPECT_THAT(far_scene.import_report().warnings.at(0), HasSubstr("has no category in a.semantic.txt"));
    EXPECT_GT(areas_of(far_scene).at("unlabelled"), 0.9 * (areas_of(load_scene(folder / "a.semantic.glb")).at("floor")));
  }
}

GltfWriter with_material(GltfWriter file) {
  file.json["materials"] = {{{"name", "own"}}};
  file.json["meshes"][0]["primitives"][0]["material"] = 0;
  return file;
}

// Annotations name nothing of a mesh that carries no numbers and no colours of theirs: a line says so, and its own names stay.
TEST(AnnotatedImport, AMeshThatCarriesNothingKeepsItsOwnNames) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const TempFolder folder;
    const AnnotatedRoom room(470 + i, i);
    const std::string bare = with_material(room.bare_gltf()).glb(), colored = with_material(room.colored_gltf()).glb();
    folder.write("a.semantic.txt", room.semantic_text());
    const Scene scene = load_scene(folder.write("a.semantic.glb", bare));
    EXPECT_EQ(scene.mesh().material_names, std::vector<std::string>{"own"});
    EXPECT_THAT(scene.import_report().warnings,
                testing::ElementsAre(HasSubstr("a.semantic.txt beside the mesh is not read: its surfaces")));
    // Matterport3D's numbers stand beside it: of two kinds of annotations the one that fits is taken.
    folder.write("a_semantic.ply", room.ply());
    folder.write("a.house", room.house());
    expect_areas_of(load_scene(folder / "a.semantic.glb"), room);

    folder.write("n/b.house", room.house());
    folder.write("n/c.json", room.replica_info());
    folder.write("n/d.semantic.txt", room.semantic_text());
    folder.write("m.glb", bare);
    folder.write("m.semantic.glb", colored);
    folder.write("m.ply", room.plain_ply());
    for (const auto& [mesh, names] : {std::pair("m.glb", "b.house"),
                                      {"m.glb", "c.json"},
                                      {"m.glb", "d.semantic.txt"},
                                      {"m.semantic.glb", "b.house"},
                                      {"m.ply", "b.house"},
                                      {"m.ply", "c.json"}}) {
      const std::string yaml = folder.write("scene.yaml", fmt::format("mesh: {}\nannotations: n/{}\n", mesh, names));
      EXPECT_THAT(message_of<InputError>([&] { load_scene(yaml); }), HasSubstr("carries no numbers for ")) << mesh << ' ' << names;
    }
    expect_areas_of(load_scene(folder.write("scene.yaml", "mesh: m.semantic.glb\nannotations: n/d.semantic.txt\n")), room);
  }
}

TEST(AnnotatedImport, APlyWithoutIdsTakesTheNextAnnotations) {
  for (std::uint32_t i = 0; i < 4; ++i) {
    const TempFolder folder;
    const AnnotatedRoom room(480 + i, i);
    // Ids are whole numbers: a property of fractions is skipped like any other.
    const std::string mesh = folder.write("mesh.ply", i % 2 == 0 ? room.plain_ply() : room.ply("object_id", "float"));
    const std::uint64_t bare = load_scene(mesh).hash();
    folder.write("info_semantic.json", room.replica_info());
    if (i >= 2) folder.write("mesh.house", room.house());
    const Scene scene = load_scene(mesh);
    EXPECT_EQ(scene.hash(), bare);
    EXPECT_THAT(scene.import_report().warnings,
                testing::ElementsAre(HasSubstr(fmt::format("{} beside the mesh is not read: its faces carry no ids",
                                                           folder / (i >= 2 ? "mesh.house" : "info_semantic.json")))));
    folder.write("habitat/info_semantic.json", room.replica_info());
    folder.write("habitat/mesh_semantic.ply", room.ply());
    expect_areas_of(load_scene(mesh), room);
  }
}

TEST(AnnotatedImport, StoredScenesDependOnTheAnnotations) {
  const TempFolder folder;
  const AnnotatedRoom room(460);
  const auto expect_depends = [&](const std::string& scene, const std::string& file, const std::string& bytes) {
    const auto before = hash_of_scene_inputs(scene);
    ASSERT_TRUE(before) << scene;
    folder.write(file, bytes);
    const auto after = hash_of_scene_inputs(scene);
    EXPECT_NE(after, before) << file;
    const auto files = files_of_scene(scene);
    ASSERT_TRUE(files);
    EXPECT_NE(std::find(files->begin(), files->end(), folder / file), files->end()) << file;
  };
  const std::string ply = folder.write("m/x_semantic.ply", room.ply());
  expect_depends(ply, "m/info_semantic.json", room.replica_info());
  expect_depends(ply, "m/info_semantic.json", room.replica_info(false));
  expect_depends(ply, "m/x.house", room.house());
  const std::string glb = folder.write("h/a.basis.glb", room.bare_gltf().glb());
  folder.write("h/a.semantic.txt", room.semantic_text());
  expect_depends(glb, "h/a.semantic.glb", room.colored_gltf().glb());
  expect_depends(glb, "h/a.semantic.txt", room.semantic_text() + "\n");
  const std::string yaml = folder.write("scene.yaml", "mesh: m/x_semantic.ply\nannotations: names.json\n");
  expect_depends(yaml, "names.json", room.replica_info());
}

}  // namespace
}  // namespace earshot
