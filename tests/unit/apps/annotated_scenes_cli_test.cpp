// SPDX-License-Identifier: Apache-2.0
// Scanned data sets keep categories in files of their own: what they say is as if the surfaces had been named by hand, for materials,
// responses and pictures of categories.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string>
#include <vector>

#include "sim/base/text/json.h"
#include "sim/vision/png_file.h"
#include "tests/support/files/annotated_room.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;

class AnnotatedScenesCli : public Cli {
 protected:
  /// A file in a folder of its own below the test's.
  std::string write_in(const std::string& folder, const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(folder_ / folder);
    return write(folder + "/" + name, text);
  }
  /// A scene YAML beside the mesh.
  std::string yaml(const std::string& folder, const std::string& mesh, const std::string& more = "") const {
    return write_in(folder, "scene.yaml", "mesh: " + mesh + "\nsemantics: indoor\n" + more);
  }
  [[nodiscard]] nlohmann::json report(const std::string& scene) const {
    const CliOutcome outcome = earshot("scene " + scene + " --json " + file("s.json"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    return parse_json(read("s.json"));
  }
  [[nodiscard]] static std::map<std::string, double> areas_of(const nlohmann::json& said) {
    std::map<std::string, double> areas;
    for (const nlohmann::json& surface : said.at("surfaces")) areas[surface.at("name")] += surface.at("area_m2").get<double>();
    return areas;
  }
  [[nodiscard]] static std::map<std::string, std::string> materials_of(const nlohmann::json& said) {
    std::map<std::string, std::string> materials;
    for (const nlohmann::json& surface : said.at("surfaces")) materials[surface.at("name")] = surface.at("material");
    return materials;
  }
  [[nodiscard]] std::vector<float> response(const std::string& scene, const AnnotatedRoom& room) const {
    const CliOutcome outcome =
        earshot("rir " + scene + " --source " + point_text(room.source()) + " --listener " + point_text(room.listener()) +
                " --preset fast --channels mono --set rays=256 rir_length_s=0.3 --out " + file("x.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    return read_wav("x.wav");
  }
  /// Fractions of a panorama, by category.
  [[nodiscard]] std::map<std::string, double> picture(const std::string& scene, const AnnotatedRoom& room) const {
    const CliOutcome outcome = earshot("render " + scene + " --sensor semantic --panorama --size 96x48 --height 0 --pose " +
                                       point_text(room.listener()) + ",0 --out " + file("x.png") + " --json " + file("x.json"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    std::map<std::string, double> fractions;
    for (const nlohmann::json& row : parse_json(read("x.json")).at("categories"))
      fractions[row.at("name").get<std::string>()] = row.at("fraction").get<double>();
    return fractions;
  }
  void expect_areas(const nlohmann::json& scene, const AnnotatedRoom& room) const {
    const std::map<std::string, double> areas = areas_of(scene);
    EXPECT_EQ(areas.size(), room.areas_m2().size());
    for (const auto& [category, area] : room.areas_m2()) {
      ASSERT_TRUE(areas.contains(category)) << category;
      EXPECT_NEAR(areas.at(category), area, 1e-4 * area) << category;
    }
  }
  /// The same materials, response and picture as the room whose surfaces are named by hand.
  void expect_like(const std::string& scene, const std::string& control, const AnnotatedRoom& room) const {
    const nlohmann::json said = report(scene);
    expect_areas(said, room);
    EXPECT_EQ(materials_of(said), materials_of(report(control)));
    EXPECT_EQ(response(scene, room), response(control, room)) << scene;
    EXPECT_EQ(picture(scene, room), picture(control, room)) << scene;
  }
  /// The same categories, but for pixels on the edges of triangles.
  void expect_like_picture(const std::string& scene, const std::string& control, const AnnotatedRoom& room) const {
    const std::map<std::string, double> seen = picture(scene, room), expected = picture(control, room);
    EXPECT_EQ(seen.size(), expected.size());
    for (const auto& [category, fraction] : expected) {
      ASSERT_TRUE(seen.contains(category)) << category;
      EXPECT_NEAR(seen.at(category), fraction, 0.002) << category;
    }
  }
  std::string control(const AnnotatedRoom& room, const std::string& more = "") const {
    write_in("control", "room.obj", room.obj());
    return yaml("control", "room.obj", more);
  }
};

TEST_F(AnnotatedScenesCli, ReplicaIsAsNamedByHand) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const AnnotatedRoom room(100 + i, i);
    write_in("replica", "mesh_semantic.ply", room.ply());
    write_in("replica", "info_semantic.json", room.replica_info(i != 1));
    const std::string more = i == 2 ? "randomize: {seed: 3}\n" : "assign: {sofa: leather_seat, \"chest*\": plywood_thin}\n";
    expect_like(yaml("replica", "mesh_semantic.ply", more), control(room, more), room);
  }
}

TEST_F(AnnotatedScenesCli, MatterportIsAsNamedByHand) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const AnnotatedRoom room(120 + i, i);
    const std::string mesh = i == 2 ? "Xq2.ply" : "Xq2_semantic.ply";
    write_in("mp3d", mesh, room.ply(i == 2 ? "face_segment" : "object_id", i == 0 ? "short" : "int"));
    write_in("mp3d", "Xq2.house", room.house());
    expect_like(yaml("mp3d", mesh), control(room), room);
  }
}

// The colours stand at the vertices, or in a texture with one texel for each face.
TEST_F(AnnotatedScenesCli, Hm3dHasTheAreasOfItsColors) {
  for (std::uint32_t i = 0; i < 4; ++i) {
    const AnnotatedRoom room(140 + i, i / 2);
    GltfWriter glb = i % 2 == 0 ? room.colored_gltf() : room.bare_gltf();
    if (i % 2 == 1) {
      std::vector<std::uint8_t> rgb;
      std::vector<float> uvs;
      const auto count = static_cast<float>(room.faces.size());
      for (std::size_t f = 0; f < room.faces.size(); ++f) {
        const std::uint32_t color = room.color_of(room.faces[f]);
        for (const unsigned shift : {16u, 8u, 0u}) rgb.push_back(static_cast<std::uint8_t>(color >> shift & 255u));
        for (const float side : {0.1f, 0.5f, 0.9f, 0.5f}) uvs.insert(uvs.end(), {(static_cast<float>(f) + side) / count, side});
      }
      const std::string png = encode_png_rgb("ids", static_cast<int>(room.faces.size()), 1, rgb);
      const std::size_t uv = glb.add_accessor(glb.add_view(uvs), uvs.size() / 2, 5126, "VEC2");
      glb.json["images"] = {{{"bufferView", glb.add_view(std::vector<char>(png.begin(), png.end()))}, {"mimeType", "image/png"}}};
      glb.json["textures"] = {{{"source", 0}}};
      glb.json["materials"] = {{{"name", "m"}, {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
      glb.json["meshes"][0]["primitives"][0]["material"] = 0;
      glb.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv;
    }
    write_in("hm3d", "00800-Ab.semantic.glb", glb.glb());
    write_in("hm3d", "00800-Ab.semantic.txt", room.semantic_text());
    const std::string scene = yaml("hm3d", "00800-Ab.semantic.glb");
    const nlohmann::json said = report(scene);
    expect_areas(said, room);
    EXPECT_EQ(materials_of(said), materials_of(report(control(room))));
    expect_like_picture(scene, control(room), room);
  }
}

// The mesh that is shown carries no ids; the annotated one of the same place stands beside it.  Basis textures are left out in one line.
TEST_F(AnnotatedScenesCli, TheMeshThatIsShownTakesTheCategoriesOfTheOther) {
  const AnnotatedRoom room(160, 1);
  GltfWriter basis = room.bare_gltf();
  basis.json["extensionsUsed"] = basis.json["extensionsRequired"] = nlohmann::json::array({"KHR_texture_basisu"});
  basis.json["images"] = {{{"bufferView", basis.add_view(std::vector<char>{'\xAB', 'K', 'T', 'X', ' ', '2', '0', '\xBB'})}}};
  basis.json["textures"] = {{{"extensions", {{"KHR_texture_basisu", {{"source", 0}}}}}}};
  basis.json["materials"] = {{{"name", "m"}, {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  basis.json["meshes"][0]["primitives"][0]["material"] = 0;
  write_in("hm3d", "a.basis.glb", basis.glb());
  write_in("hm3d", "a.semantic.glb", room.colored_gltf().glb());
  write_in("hm3d", "a.semantic.txt", room.semantic_text());
  write_in("mp3d", "b.glb", room.bare_gltf().glb());
  write_in("mp3d", "b_semantic.ply", room.ply());
  write_in("mp3d", "b.house", room.house());
  write_in("replica", "mesh.ply", room.plain_ply());
  write_in("replica/habitat", "mesh_semantic.ply", room.ply());
  write_in("replica/habitat", "info_semantic.json", room.replica_info());
  for (const auto& [folder, mesh] : {std::pair("hm3d", "a.basis.glb"), std::pair("mp3d", "b.glb"), std::pair("replica", "mesh.ply")}) {
    const std::string scene = yaml(folder, mesh);
    const nlohmann::json said = report(scene);
    expect_areas(said, room);
    expect_like_picture(scene, control(room), room);
  }
  const CliOutcome outcome = earshot("render " + file("hm3d/a.basis.glb") + " --sensor rgb --size 16x16 --height 0 --pose " +
                                     point_text(room.listener()) + ",0 --out " + file("x.png"));
  EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
  EXPECT_THAT(outcome.errors, HasSubstr("textures that are neither PNG nor JPEG are left out: 1 (of material m)"));
}

TEST_F(AnnotatedScenesCli, TheAreaWithoutACategoryIsSaidInOneLine) {
  for (std::uint32_t i = 0; i < 4; ++i) {
    const AnnotatedRoom room(180 + i, i);
    write_in("replica", "mesh_semantic.ply", room.ply());
    write_in("replica", "info_semantic.json", room.replica_info());
    const CliOutcome outcome =
        earshot("rir " + yaml("replica", "mesh_semantic.ply") + " --source " + point_text(room.source()) + " --listener " +
                point_text(room.listener()) + " --preset fast --channels mono --set rays=16 rir_length_s=0.1 --out " + file("x.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    if (i == 0) {
      EXPECT_EQ(outcome.errors, "");
      continue;
    }
    EXPECT_THAT(outcome.errors, HasSubstr(fmt::format("{:.1f} % of the area ({} of 24 triangles) has no category in info_semantic.json",
                                                      room.unlabelled_percent(), 2 * i)));
    EXPECT_EQ(std::count(outcome.errors.begin(), outcome.errors.end(), '\n'), 1) << outcome.errors;
  }
}

// A material file in the original's layout finds the categories by its labels, as whole words or as the original does.
TEST_F(AnnotatedScenesCli, MaterialFilesOfTheOriginalFindTheCategories) {
  const AnnotatedRoom room(190);
  write_in("replica", "mesh_semantic.ply", room.ply());
  write_in("replica", "info_semantic.json", room.replica_info());
  const std::string curves = R"("scattering": [125, 0.1, 4000, 0.2], "transmission": [125, 0.03, 4000, 0.002],
    "damping": [22.28, 1.2e-10, 17953.7, 7.5e-5], "density": 998.65, "speed": 1483.96)";
  write_in("replica", "original.json",
           R"({"materials": [{"name": "Default", "labels": ["default"], "absorption": [20, 0.1, 20000, 0.1], )" + curves +
               R"(}, {"name": "Gypsum Board", "labels": ["wall"], "absorption": [125, 0.29, 4000, 0.09], )" + curves +
               R"(}, {"name": "wood, Thick", "labels": ["chest", "chair"], "absorption": [125, 0.19, 4000, 0.05], )" + curves + "}]}");
  for (const bool is_legacy : {false, true}) {
    const std::string scene = write_in(
        "replica", "room.yaml",
        "mesh: mesh_semantic.ply\nmaterials: original.json\nlabel_matching: " + std::string(is_legacy ? "legacy_substring\n" : "exact\n"));
    std::map<std::string, std::string> materials = materials_of(report(scene));
    EXPECT_EQ(materials.at("wall"), "Gypsum Board");
    EXPECT_EQ(materials.at("chest of drawers"), is_legacy ? "wood, Thick" : "Default");
    EXPECT_EQ(materials.at("sofa"), "Default");
  }
}

TEST_F(AnnotatedScenesCli, AnnotationsAreNamedInTheSceneOrMissing) {
  const AnnotatedRoom room(200);
  write_in("lone", "room.ply", room.ply());
  EXPECT_THAT(report(yaml("lone", "room.ply")).at("warnings").dump(), HasSubstr("faces carry object ids"));
  write_in("elsewhere", "names.json", room.replica_info());
  write_in("elsewhere", "names.house", room.house());
  for (const char* names : {"names.json", "names.house"}) {
    const nlohmann::json said = report(yaml("lone", "room.ply", std::string("annotations: ../elsewhere/") + names + "\n"));
    expect_areas(said, room);
    EXPECT_EQ(said.at("warnings").dump(), "[]");
  }
  write_in("half", "a.semantic.glb", room.colored_gltf().glb());
  EXPECT_THAT(report(file("half/a.semantic.glb")).at("warnings").dump(), HasSubstr("a.semantic.txt is not there"));
  write_in("half", "a.basis.glb", room.bare_gltf().glb());
  EXPECT_THAT(report(file("half/a.basis.glb")).at("warnings").dump(), HasSubstr("a.semantic.txt is not there"));
  write_in("gibson", "a.glb", room.bare_gltf().glb());
  write_in("gibson", "a.scn", "scn");
  EXPECT_THAT(report(file("gibson/a.glb")).at("warnings").dump(), HasSubstr("a.scn is not read"));
}

TEST_F(AnnotatedScenesCli, DamagedAndForeignFilesAreRefusedInOneLine) {
  const AnnotatedRoom room(220);
  write_in("r", "mesh_semantic.ply", room.ply());
  const std::string info = room.replica_info(), house = room.house(), text = room.semantic_text();
  write_in("r", "info_semantic.json", info.substr(0, info.size() / 2));
  expect_bad_input("scene " + file("r/mesh_semantic.ply"), "info_semantic.json: is not JSON");
  write_in("m", "a_semantic.ply", room.ply());
  write_in("m", "a.house", house.substr(0, house.rfind("O ")));
  expect_bad_input("scene " + file("m/a_semantic.ply"), "a.house: promises 12 objects");
  write_in("h", "a.semantic.glb", room.colored_gltf().glb());
  write_in("h", "a.semantic.txt", text.substr(0, text.size() - 8));
  expect_bad_input("scene " + file("h/a.semantic.glb"), "a.semantic.txt:13");
  expect_bad_input("scene " + yaml("h", "a.semantic.glb", "annotations: none.house\n"), "none.house");
  write_in("h", "a.scn", "scn");
  expect_bad_input("scene " + yaml("h", "a.semantic.glb", "annotations: a.scn\n"), "a.scn: is not a file of annotations that is read");
  write_in("h", "plain.obj", room.obj());
  write_in("h", "b.house", room.house());
  expect_bad_input("scene " + yaml("h", "plain.obj", "annotations: b.house\n"), "b_semantic.ply is not there");
  expect_bad_input("scene " + yaml("h", "shoebox:3x3x3", "annotations: b.house\n"),
                   "annotations have no effect on a generated mesh, a point cloud or a scene of Habitat");
  const std::map<std::string, std::string> others{{"a.navmesh", "navigation mesh"},  {"a.scn", "Gibson"},
                                                  {"a.house", "Matterport3D"},       {"a.semantic.txt", "HM3D"},
                                                  {"info_semantic.json", "Replica"}, {"a.object_config.json", "Habitat"},
                                                  {"a.stage_config.json", "Habitat"}};
  for (const auto& [name, said] : others) {
    expect_bad_input("scene " + write(name, "x"), said);
    expect_bad_input("scene " + write("other.yaml", "mesh: " + name + "\n"), said);
  }
}

TEST_F(AnnotatedScenesCli, TheRoomOfTheFieldDecaysAsItsControl) {
  SKIP_WITHOUT_DATA("field/c13_replica.yaml");
  const auto response_of = [&](const std::string& name) {
    const CliOutcome outcome = earshot("rir " + (data_folder() / "field" / name).string() +
                                       " --source 1,1.5,1 --listener 3.5,1.2,2.5 --preset fast --channels mono --out " + file("x.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    EXPECT_EQ(outcome.errors, "");
    return read_wav("x.wav");
  };
  // The files list their triangles in other orders, so the draws differ.  Of a window of 100 ms some 800 independent samples scatter by 0.2
  // dB.
  const auto levels_db = [](const std::vector<float>& response) {
    std::vector<double> levels;
    for (std::size_t begin = 0; begin + 1600 <= std::min<std::size_t>(response.size(), 8000); begin += 1600)
      levels.push_back(10 * std::log10(std::transform_reduce(response.begin() + static_cast<std::ptrdiff_t>(begin),
                                                             response.begin() + static_cast<std::ptrdiff_t>(begin + 1600), 0.,
                                                             std::plus<>(), [](float sample) { return double{sample} * sample; })));
    return levels;
  };
  const std::vector<double> replica = levels_db(response_of("c13_replica.yaml")), control = levels_db(response_of("c13_control.yaml"));
  ASSERT_EQ(control.size(), 5U);
  EXPECT_THAT(replica, testing::Pointwise(testing::DoubleNear(1), control));
  EXPECT_EQ(materials_of(report((data_folder() / "field/c13_assign.yaml").string())).at("floor"), "carpet_heavy_on_concrete");
}

}  // namespace
}  // namespace earshot
