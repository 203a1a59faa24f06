// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <glm/geometric.hpp>

#include "sim/base/errors.h"
#include "sim/scene/generators/shoebox.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

std::string error_of(const std::string& spec) {
  return message_of<InputError>([&] { load_scene(spec); });
}

std::string material_at(const Scene& scene, glm::vec3 origin, glm::vec3 direction) {
  const Hit hit = scene.rays().intersect(origin, direction);
  return hit.valid() ? scene.materials()[scene.mesh().triangle_material[hit.triangle]].name : "nothing";
}

// ISO 9613-1: 343.2 m/s sqrt(T / 293.15 K); the values of docs/evidence/oracles.md, Conventions.
TEST(Air, SpeedOfSoundFollowsTheTemperature) {
  const float expected[][2] = {{0, 331.286f}, {10, 337.296f}, {15, 340.261f}, {20, 343.2f}, {25, 346.114f}, {30, 349.005f}};
  for (const auto& [celsius, speed] : expected) EXPECT_NEAR(Air{.temperature_c = celsius}.speed(), speed, 6e-4f);
  EXPECT_EQ((Air{.temperature_c = 30, .speed_of_sound_m_per_s = 343}.speed()), 343);
}

TEST(Shoebox, StandsAtTheOriginWithAWallPerSlot) {
  const Scene scene = load_scene("shoebox:6x3x4.5@0.1,0.2,0.3,0.4,0.5,0.6");
  EXPECT_EQ(scene.name(), "shoebox:6x3x4.5@0.1,0.2,0.3,0.4,0.5,0.6");
  EXPECT_EQ(scene.bounds().lower, glm::vec3(0));
  EXPECT_EQ(scene.bounds().upper, glm::vec3(6, 3, 4.5f));
  EXPECT_EQ(scene.mesh().triangles.size(), 12u);
  EXPECT_THAT(scene.mesh().material_names, ElementsAre("x0", "x1", "y0", "y1", "z0", "z1"));
  const glm::vec3 middle(2.5f, 1.2f, 2.1f);
  const glm::vec3 outward[6] = {{-1, 0, 0}, {1, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, -1}, {0, 0, 1}};
  const float distance[6] = {2.5f, 3.5f, 1.2f, 1.8f, 2.1f, 2.4f}, area[6] = {13.5f, 13.5f, 27, 27, 18, 18};
  for (std::uint32_t wall = 0; wall < 6; ++wall) {
    const Hit hit = scene.rays().intersect(middle, outward[wall]);
    ASSERT_TRUE(hit.valid());
    EXPECT_NEAR(hit.distance_m, distance[wall], 1e-5f);
    EXPECT_EQ(scene.mesh().triangle_material[hit.triangle], wall);
    EXPECT_FLOAT_EQ(scene.materials()[wall].absorption.at(1000), 0.1f * static_cast<float>(wall + 1));
    EXPECT_EQ(scene.materials()[wall].transmission.at(1000), 0);
    EXPECT_FLOAT_EQ(scene.triangle_area_m2(2 * wall) + scene.triangle_area_m2(2 * wall + 1), area[wall]);
  }
}

TEST(Shoebox, TakesNamesNumbersAndTheDefault) {
  EXPECT_EQ(load_scene("shoebox:1x1x1").materials()[3].name, "default");
  EXPECT_EQ(load_scene("shoebox:1x1x1@marble").materials()[5].name, "marble");
  const Scene mixed = load_scene("shoebox:1x1x1@0.25,marble,0,1,linoleum,0.5");
  EXPECT_EQ(mixed.materials()[4].name, "linoleum");
  EXPECT_EQ(mixed.materials()[3].absorption.at(500), 1);
  const Material fallback = *MaterialDatabase::builtin().find_label("default");
  EXPECT_EQ(mixed.materials()[0].scattering.value, fallback.scattering.value) << "a bare absorption scatters like the default material";
}

TEST(Shoebox, RefusesNonsense) {
  for (const char* spec : {"shoebox:", "shoebox:6x3", "shoebox:6x3x4x5", "shoebox:6x3x0", "shoebox:-6x3x4", "shoebox:6xax4",
                           "shoebox:6x3x4@", "shoebox:6x3x4@1.5", "shoebox:6x3x4@-0.1", "shoebox:6x3x4@0.1,0.2", "shoebox:nanx3x4",
                           "shoebox:infx3x4", "shoebox:6x3x4@0.1,0.1,0.1,0.1,0.1,nan"}) {
    EXPECT_THAT(error_of(spec), AllOf(HasSubstr("shoebox:"), Not(HasSubstr("\n")))) << spec;
  }
  EXPECT_THAT(error_of("shoebox:6x3x4@mabrle"), HasSubstr("did you mean 'marble'?"));
}

TEST(LoadScene, RefusesWhatIsNoScene) {
  EXPECT_THAT(error_of("nothing"), HasSubstr("not a scene"));
  EXPECT_THAT(error_of(""), HasSubstr("not a scene"));
  EXPECT_THAT(error_of("gone.glb"), HasSubstr("gone.glb"));
  EXPECT_THAT(error_of("gone.yaml"), HasSubstr("gone.yaml"));
  EXPECT_NE(error_of("house:"), "");
}

TEST(LoadScene, HousesTakeTheirMaterialsByName) {
  const Scene house = load_scene("house:3,rooms=2,area_m2=30");
  ASSERT_FALSE(house.materials().empty());
  for (std::size_t slot = 0; slot < house.materials().size(); ++slot)
    EXPECT_EQ(house.materials()[slot].name, house.mesh().material_names[slot]);
}

TEST(Scene, HashCoversGeometryMaterialsAndAir) {
  const auto make = [](float size, float absorption, const Air& air) {
    TriangleMesh mesh = make_shoebox({size, 3, 4});
    return Scene("s", std::move(mesh), std::vector<Material>(6, Material::uniform("m", absorption, 0.5f)), air).hash();
  };
  const std::uint64_t hash = make(5, 0.1f, {});
  EXPECT_EQ(make(5, 0.1f, {}), hash);
  EXPECT_NE(make(5.001f, 0.1f, {}), hash);
  EXPECT_NE(make(5, 0.1001f, {}), hash);
  EXPECT_NE(make(5, 0.1f, {.humidity_percent = 51}), hash);
  EXPECT_NE(make(5, 0.1f, {.speed_of_sound_m_per_s = 343}), hash);
}

TEST(Scene, Moves) {
  Scene scene = load_scene("shoebox:6x3x4");
  const std::uint64_t hash = scene.hash();
  const Scene moved = std::move(scene);
  EXPECT_EQ(moved.hash(), hash);
  EXPECT_NEAR(moved.rays().intersect({1, 1, 1}, {1, 0, 0}).distance_m, 5, 1e-5);
}

/// A floor of 4 x 4 m with one wall, in centimetres and z up; node names "floor" and "back".
const char* const open_room =
    "o floor\nusemtl Tiles/A\nv 0 0 0\nv 400 0 0\nv 400 400 0\nv 0 400 0\nf 1 2 3 4\n"
    "o back\nusemtl paint\nv 0 0 250\nv 400 0 250\nf 1 2 6 5\n";

TEST(SceneYaml, ReadsEveryKey) {
  const TempFolder folder;
  folder.write("meshes/room.obj", open_room);
  folder.write("db.json", R"({"materials": [{"name": "felt", "labels": ["ceiling_lid"], "absorption": [125, 0.5], "scattering": [125, 0.1]},
                                           {"name": "slate", "labels": ["default"], "absorption": [125, 0.1], "scattering": [125, 0.1], "transmission": [125, 0.2]}]})");
  const Scene scene = load_scene(folder.write("scenes/room.yaml",
                                              "mesh: ../meshes/room.obj\nup: z\nunit_m: 0.01\nceiling_m: 2.5\nmaterials: ../db.json\n"
                                              "assign:\n  \"Tiles*\": slate\n  unmatched: felt\n"
                                              "air: {temperature_c: 25, humidity_percent: 30, pressure_kpa: 90}\ntwo_sided: true\n"));
  EXPECT_LT(glm::length(scene.bounds().lower - glm::vec3(0, 0, -4)), 1e-5f);
  EXPECT_LT(glm::length(scene.bounds().upper - glm::vec3(4, 2.5f, 0)), 1e-5f);
  EXPECT_EQ(material_at(scene, {1, 1, -1}, {0, -1, 0}), "slate");
  EXPECT_EQ(material_at(scene, {1, 1, -1}, {0, 1, 0}), "felt") << "the lid, by its label";
  EXPECT_EQ(material_at(scene, {1, 1, -1}, {0, 0, 1}), "slate") << "default by label";
  EXPECT_EQ(material_at(scene, {1, 1, -1}, {1, 0, 0}), "nothing");
  EXPECT_THAT(scene.mesh().object_names, ElementsAre("floor", "back", "ceiling_lid"));
  EXPECT_NEAR(scene.speed_of_sound_m_per_s(), 346.114f, 6e-4f);
  EXPECT_EQ(scene.air().pressure_kpa, 90);
  EXPECT_THAT(scene.import_report().warnings, ElementsAre(HasSubstr("slate"), HasSubstr("unmatched")));
}

TEST(SceneYaml, TakesAShoeboxWithItsAir) {
  const TempFolder folder;
  const Scene scene =
      load_scene(folder.write("s.yml", "mesh: shoebox:6x3x4@0.1\nassign: {y0: wood_parquet}\nair: {speed_of_sound_m_per_s: 343}\n"));
  EXPECT_EQ(scene.speed_of_sound_m_per_s(), 343);
  EXPECT_EQ(scene.materials()[2].name, "wood_parquet");
  EXPECT_FLOAT_EQ(scene.materials()[0].absorption.at(1000), 0.1f);
}

TEST(SceneYaml, RefusesWhatIsWrongInOneLine) {
  const TempFolder folder;
  folder.write("room.obj", open_room);
  const auto error = [&](const std::string& yaml) { return error_of(folder.write("s.yaml", yaml)); };
  ASSERT_EQ(error("mesh: room.obj\nunit_m: 0.01\n"), "");
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"up: y\n", "mesh"},
      {"mesh: room.obj\nunits_m: 1\n", "units_m"},
      {"mesh: gone.obj\n", "gone.obj"},
      {"mesh: room.obj\nup: x\n", "up"},
      {"mesh: room.obj\nunit_m: 0\n", "unit_m"},
      {"mesh: room.obj\nunit_m: .nan\n", "unit_m"},
      {"mesh: room.obj\nunit_m: big\n", "unit_m"},
      {"mesh: room.obj\nceiling_m: -1\n", "ceiling_m"},
      {"mesh: room.obj\nceiling_m: .inf\n", "ceiling_m"},
      {"mesh: room.obj\nsimplify_m: 0\n", "simplify_m"},
      {"mesh: room.obj\nsimplify_m: 2\n", "simplify_m"},
      {"mesh: room.obj\nmaterials: gone.json\n", "gone.json"},
      {"mesh: room.obj\nassign: {paint: gypsum_bord}\n", "gypsum_board"},
      {"mesh: room.obj\nassign: [paint]\n", "assign"},
      {"mesh: room.obj\nassign: {paint: [a]}\n", "paint"},
      {"mesh: room.obj\ndefault_material: marbel\n", "marble"},
      {"mesh: room.obj\nair: {temperature: 20}\n", "temperature"},
      {"mesh: room.obj\nair: {temperature_c: 60}\n", "temperature_c"},
      {"mesh: room.obj\nair: {humidity_percent: .nan}\n", "humidity_percent"},
      {"mesh: room.obj\nair: {pressure_kpa: 10}\n", "pressure_kpa"},
      {"mesh: room.obj\nair: {speed_of_sound_m_per_s: -1}\n", "speed_of_sound_m_per_s"},
      {"mesh: room.obj\ntwo_sided: false\n", "two_sided"},
      {"mesh: shoebox:1x1x1\nup: z\n", "generated"},
      {"mesh: s.yaml\n", "s.yaml"},
      {"- a list\n", "s.yaml"},
      {"mesh: [\n", "s.yaml"},
      {"", "s.yaml"},
  };
  for (const auto& [yaml, hint] : wrong) EXPECT_THAT(error(yaml), AllOf(HasSubstr(hint), Not(HasSubstr("\n")))) << yaml;
}

TEST(SceneYaml, RandomizationOfNothingKeepsWhatTheUserWrote) {
  const TempFolder folder;
  const auto absorption = [&](const std::string& randomize) {
    const Scene scene = load_scene(folder.write("r.yaml", "mesh: shoebox:5x4x3@0.3\n" + randomize));
    return scene.materials()[0].absorption.at(1000.f);
  };
  EXPECT_FLOAT_EQ(absorption(""), 0.3f);
  EXPECT_FLOAT_EQ(absorption("randomize: {candidates: false, noise_std: 0, transmission_noise_db: 0}\n"), 0.3f);
  EXPECT_FLOAT_EQ(absorption("randomize: {noise_std: 0, transmission_noise_db: 0}\n"), 0.3f);
  EXPECT_NE(absorption("randomize: {seed: 1}\n"), 0.3f);
}

}  // namespace
}  // namespace earshot
