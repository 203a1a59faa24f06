// SPDX-License-Identifier: Apache-2.0
// glTF features that change geometry: `earshot scene` and `rir` apply them, refuse them by name, or name them in a warning.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/programs/mesh_cli.h"

namespace earshot {
namespace {

using random_rooms::Draws;
using random_rooms::Room;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

/// Positions and corners of a mesh as accessors, and a primitive of them.
nlohmann::json add_primitive(GltfWriter& file, const mesh_cases::DoubleMesh& mesh) {
  std::vector<float> xyz;
  for (const glm::dvec3 v : mesh.vertices)
    for (int axis = 0; axis < 3; ++axis) xyz.push_back(static_cast<float>(v[axis]));
  std::vector<std::uint16_t> corners;
  for (const glm::uvec3 t : mesh.triangles)
    for (int c = 0; c < 3; ++c) corners.push_back(static_cast<std::uint16_t>(t[c]));
  const std::size_t positions = file.add_positions(xyz),
                    indices = file.add_accessor(file.add_view(corners), corners.size(), 5123, "SCALAR");
  return {{"attributes", {{"POSITION", positions}}}, {"indices", indices}};
}

/// A file of the room alone: mesh 0, node 0.
GltfWriter room_file(const Room& room) {
  GltfWriter file;
  file.json["meshes"] = {{{"primitives", {add_primitive(file, room.mesh)}}}};
  file.json["nodes"] = {{{"name", "room"}, {"mesh", 0}}};
  file.json["scenes"] = {{{"nodes", {0}}}};
  return file;
}

TEST_F(MeshCli, GltfRequiredExtensionsAreRefusedByName) {
  for (std::uint32_t number = 0; number < kRooms; ++number) {
    Draws draws(21, number);
    GltfWriter file = room_file(random_rooms::room(draws));
    std::string name = number == 0 ? "KHR_draco_mesh_compression" : number == 1 ? "KHR_meshopt_compression" : "EXT_";
    while (name.size() < 12) name += static_cast<char>('a' + draws.below(26));
    file.json["extensionsUsed"] = {"KHR_texture_transform", name};
    file.json["extensionsRequired"] = {"KHR_texture_transform", name};
    const std::string mesh = write(std::to_string(number) + "a.gltf", file.gltf());
    expect_bad_input("scene " + mesh, name);
    expect_bad_input("rir " + mesh + " --source 1,1,1 --listener 1,1.5,1 --out " + this->file("a.wav"), name);
    EXPECT_FALSE(std::filesystem::exists(this->file("a.wav")));
  }
  SKIP_WITHOUT_DATA("field/c04_required_unknown.gltf");
  expect_bad_input("scene " + (data_folder() / "field/c04_required_unknown.gltf").string(), "EXT_QuantumRendering");
}

TEST_F(MeshCli, GltfMinimumVersionsAboveTwoAreRefused) {
  for (std::uint32_t number = 0; number < kRooms; ++number) {
    Draws draws(22, number);
    GltfWriter file = room_file(random_rooms::room(draws));
    const std::string version = fmt::format("{}.{}", 2 + draws.below(2), 1 + draws.below(20));
    file.json["asset"] = {{"version", version.substr(0, 1) == "2" ? version : "2.0"}, {"minVersion", version}};
    const std::string mesh = write(std::to_string(number) + "a.glb", file.glb());
    expect_bad_input("scene " + mesh, "glTF " + version);
    expect_bad_input("rir " + mesh + " --source 1,1,1 --listener 1,1.5,1 --out " + this->file("a.wav"), "glTF " + version);
  }
  expect_random_rooms(23, "a.gltf", [](const Room& room, Draws& draws, std::uint32_t number) {
    GltfWriter file = room_file(room);
    file.json["asset"] = {{"version", fmt::format("2.{}", draws.below(9))}};
    if (number % 2) file.json["asset"]["minVersion"] = "2.0";
    return file.gltf();
  });
  SKIP_WITHOUT_DATA("field/c04_min_version_2_1.gltf");
  expect_bad_input("scene " + (data_folder() / "field/c04_min_version_2_1.gltf").string(), "glTF 2.1");
  expect_field_file("c04_version_2_1_no_min.gltf");
}

// Panels hang in the room: as many as the attributes have, where they say, whatever of translation, rotation and scale is there.
TEST_F(MeshCli, GltfInstancesAreAllThere) {
  for (std::uint32_t number = 0; number < kRooms; ++number) {
    Draws draws(24, number);
    Room room = random_rooms::room(draws);
    GltfWriter file = room_file(room);
    const mesh_cases::DoubleMesh panel{{{0, 0, 0}, {0.5, 0, 0}, {0, 0, 0.5}, {0.5, 0, 0.5}}, {{0, 1, 2}, {1, 3, 2}}};
    file.json["meshes"].push_back({{"name", "panel"}, {"primitives", {add_primitive(file, panel)}}});
    const std::size_t count = 1 + draws.below(20);
    std::vector<float> translations, rotations, scales;
    for (std::size_t i = 0; i < count; ++i) {
      for (int axis = 0; axis < 3; ++axis)
        translations.push_back(static_cast<float>(room.lower[axis] + room.size_m[axis] * draws.between(0.3, 0.7)));
      const double angle = draws.between(0, 6);
      for (const double q : {0.0, std::sin(angle / 2), 0.0, std::cos(angle / 2)}) rotations.push_back(static_cast<float>(q));
      for (int axis = 0; axis < 3; ++axis) scales.push_back(static_cast<float>(draws.between(0.5, 1)));
    }
    const auto accessor = [&](const std::vector<float>& values, const char* type) {
      return file.add_accessor(file.add_view(values), count, 5126, type);
    };
    nlohmann::json attributes{{"TRANSLATION", accessor(translations, "VEC3")}};
    if (draws.coin()) attributes["ROTATION"] = accessor(rotations, "VEC4");
    if (draws.coin()) attributes["SCALE"] = accessor(scales, "VEC3");
    file.json["nodes"].push_back({{"mesh", 1}, {"extensions", {{"EXT_mesh_gpu_instancing", {{"attributes", attributes}}}}}});
    file.json["scenes"] = {{{"nodes", {0, 1}}}};
    file.json["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
    if (draws.coin()) file.json["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
    const std::string mesh = write(std::to_string(number) + "a.gltf", file.gltf());
    const nlohmann::json report = scene(mesh);
    // Two panels at the same place are one: the coordinates of a draw are never equal here.
    EXPECT_EQ(report.at("triangles"), 12 + 2 * count) << mesh;
    EXPECT_THAT(report.at("warnings").get<std::vector<std::string>>(), IsEmpty()) << mesh;
    if (number == 0) expect_response(mesh, room);
  }
  SKIP_WITHOUT_DATA("field/c02_instancing_used.gltf");
  expect_field_file("c02_instancing_used.gltf", 20);
}

// Attributes of the user's own count instances too; none, or more than memory holds, are refused before anything is read.
TEST_F(MeshCli, GltfInstancesAreCountedByAnyAttribute) {
  const auto with_attributes = [&](const auto& attributes_of) {
    Draws draws(26, 0);
    GltfWriter file = room_file(random_rooms::room(draws));
    file.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"] = {{"attributes", attributes_of(file)}};
    file.json["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
    return write("own.gltf", file.gltf());
  };
  const std::string first_file = with_attributes([](GltfWriter& file) {
    return nlohmann::json{{"_FEATURE_ID_0", file.add_accessor(file.add_view(std::vector<float>{7}), 1, 5126, "SCALAR")}};
  });
  EXPECT_EQ(scene(first_file).at("triangles"), 12);
  const auto refused = [&](const std::string& mesh, const char* why) {
    const CliOutcome outcome = earshot("scene " + mesh);
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_THAT(outcome.errors, HasSubstr(why));
  };
  refused(with_attributes([](GltfWriter&) { return nlohmann::json::object(); }), "no instances");
  refused(with_attributes([](GltfWriter& file) {
            file.json["accessors"].push_back({{"componentType", 5126}, {"count", 1 << 28}, {"type", "VEC3"}});
            return nlohmann::json{{"TRANSLATION", file.json["accessors"].size() - 1}};
          }),
          "instances of one mesh");
}

// The corners above the floor rise by the weighted sum of the targets.  A node's weights come before the mesh's; without any they are zero.
TEST_F(MeshCli, GltfDefaultWeightsOfMorphTargetsCount) {
  for (std::uint32_t number = 0; number < kRooms; ++number) {
    Draws draws(25, number);
    const Room room = random_rooms::room(draws);
    GltfWriter file = room_file(room);
    const std::size_t num_targets = 1 + draws.below(3);
    std::vector<double> mesh_weights, node_weights, rises_m;
    nlohmann::json targets = nlohmann::json::array();
    for (std::size_t i = 0; i < num_targets; ++i) {
      rises_m.push_back(draws.between(0.2, 1.5));
      mesh_weights.push_back(draws.between(0, 1));
      node_weights.push_back(draws.between(0, 1));
      std::vector<float> offsets;
      for (const glm::dvec3 v : room.mesh.vertices)
        offsets.insert(offsets.end(), {0.f, v.y > room.lower.y ? static_cast<float>(rises_m.back()) : 0.f, 0.f});
      targets.push_back({{"POSITION", file.add_positions(offsets)}});
    }
    file.json["meshes"][0]["primitives"][0]["targets"] = targets;
    const bool has_mesh_weights = draws.coin(), has_node_weights = draws.coin();
    if (has_mesh_weights) file.json["meshes"][0]["weights"] = mesh_weights;
    if (has_node_weights) file.json["nodes"][0]["weights"] = node_weights;
    double rise_m = 0;
    for (std::size_t i = 0; i < num_targets; ++i)
      rise_m += rises_m[i] * (has_node_weights ? node_weights[i] : has_mesh_weights ? mesh_weights[i] : 0);
    const std::string mesh = write(std::to_string(number) + "a.glb", file.glb());
    expect_room(mesh, 12, room.size_m.x * (room.size_m.y + rise_m) * room.size_m.z);
    if (number == 0) expect_response(mesh, room);
  }
  SKIP_WITHOUT_DATA("field/c03_morph_mesh_weight.gltf");
  expect_field_file("c03_morph_no_weight.gltf", 12, 60);
  expect_field_file("c03_morph_mesh_weight.gltf", 12, 80);
  expect_field_file("c03_morph_node_weight.gltf", 12, 100);
}

// Where geometry is, an unknown extension is named, by `scene` and by `rir`; at a material it is not.
TEST_F(MeshCli, GltfUnknownExtensionsOfGeometryAreNamed) {
  for (std::uint32_t number = 0; number < kRooms; ++number) {
    Draws draws(26, number);
    const Room room = random_rooms::room(draws);
    GltfWriter file = room_file(room);
    std::string name = "EXT_";
    while (name.size() < 12) name += static_cast<char>('a' + draws.below(26));
    const nlohmann::json extension{{name, nlohmann::json::object()}};
    file.json["materials"] = {{{"name", "wall"}}};
    nlohmann::json* const places[] = {&file.json["nodes"][0], &file.json["meshes"][0], &file.json["meshes"][0]["primitives"][0],
                                      &file.json["bufferViews"][0], &file.json["materials"][0]};
    const std::size_t place = number % 5;
    (*places[place])["extensions"] = extension;
    file.json["extensionsUsed"] = {name};
    const std::string mesh = write(std::to_string(number) + "a.gltf", file.gltf());
    const auto warnings = scene(mesh).at("warnings").get<std::vector<std::string>>();
    if (place == 4)
      EXPECT_THAT(warnings, IsEmpty());
    else
      EXPECT_THAT(warnings, Contains(HasSubstr(name)));
    const CliOutcome heard = earshot(response_command(mesh, room.lower + 0.3 * room.size_m, room.lower + 0.7 * room.size_m));
    EXPECT_EQ(heard.exit_code, 0) << heard.errors;
    EXPECT_EQ(heard.errors.find(name) != std::string::npos, place != 4) << heard.errors;
  }
}

}  // namespace
}  // namespace earshot
