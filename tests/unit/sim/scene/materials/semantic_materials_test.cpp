// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/semantic_materials.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "sim/base/errors.h"
#include "sim/scene/scene.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// mpcat40, the category list of Matterport3D.
constexpr const char* kMatterport[] = {
    "void",        "wall",       "floor",      "chair",    "door",    "table",         "picture",
    "cabinet",     "cushion",    "window",     "sofa",     "bed",     "curtain",       "chest_of_drawers",
    "plant",       "sink",       "stairs",     "ceiling",  "toilet",  "stool",         "towel",
    "mirror",      "tv_monitor", "shower",     "column",   "bathtub", "counter",       "fireplace",
    "lighting",    "beam",       "railing",    "shelving", "blinds",  "gym_equipment", "seating",
    "board_panel", "furniture",  "appliances", "clothes",  "objects", "misc",          "unlabeled"};

TEST(SemanticMaterials, CoverMatterportAndNameMaterialsThatExist) {
  const SemanticMaterials semantics = SemanticMaterials::indoor();
  const MaterialDatabase database = MaterialDatabase::builtin();
  EXPECT_NO_THROW(semantics.require_materials(database));
  for (const char* category : kMatterport) EXPECT_EQ(semantics.category_of(category), category);
  // Matterport's and Habitat's own spellings, and Replica's.
  for (const char* name :
       {"chest of drawers", "tv monitor", "gym equipment", "indoor-plant", "Shower Stall", "set-of-clothing", "ceiling lamp",
        "base-cabinet", "wall-plug", "major-appliance", "kitchen cabinet", "picture", "refrigerator", "tv-screen", "nightstand"}) {
    EXPECT_NE(semantics.category_of(name), "") << name;
  }
  for (const auto& [category, names] : semantics.all()) {
    EXPECT_EQ(semantics.materials_of(category, database).size(), names.size()) << category;
    std::vector<std::string> sorted = names;
    std::ranges::sort(sorted);
    EXPECT_EQ(std::ranges::adjacent_find(sorted), sorted.end()) << category << " names a material twice";
  }
  for (const char* category : {"wall", "floor", "ceiling", "door", "window", "table", "chair", "sofa", "curtain"}) {
    EXPECT_GE(semantics.all().at(category).size(), 2u) << category;
  }
}

TEST(SemanticMaterials, CategoriesAreWholeWords) {
  const SemanticMaterials semantics = SemanticMaterials::indoor();
  EXPECT_EQ(semantics.category_of("vegetable"), "");
  EXPECT_EQ(semantics.category_of("wall-lamp"), "wall_lamp");
  EXPECT_EQ(semantics.category_of("wallpaper"), "");
  EXPECT_EQ(semantics.category_of("Chair.003"), "chair");
  EXPECT_EQ(semantics.category_of("chair_12"), "chair");
  EXPECT_EQ(semantics.category_of("Living Room/Sofa_2"), "sofa");
  EXPECT_EQ(semantics.category_of("sofa/leather"), "sofa");
  for (const char* nothing : {"", "/", "12", "_1", "//"}) EXPECT_EQ(semantics.category_of(nothing), "") << nothing;
}

TEST(SemanticMaterials, RefusesWhatIsWrong) {
  const auto error_of = [](const std::string& yaml) {
    return message_of<InputError>([&] { SemanticMaterials::from_yaml(yaml, "s.yaml").require_materials(MaterialDatabase::builtin()); });
  };
  EXPECT_EQ(error_of("categories: {wall: [marble]}"), "");
  EXPECT_THAT(error_of("categories: {wall: [marbel]}"), AllOf(HasSubstr("s.yaml: categories.wall"), HasSubstr("'marble'")));
  EXPECT_THAT(error_of("categories: {wall: []}"), HasSubstr("categories.wall"));
  EXPECT_THAT(error_of("categories: {wall: marble}"), HasSubstr("categories.wall"));
  EXPECT_THAT(error_of("categories: {wall: [[marble]]}"), HasSubstr("categories.wall"));
  EXPECT_THAT(error_of("categories: {wall lamp: [marble], Wall-Lamp: [marble]}"), HasSubstr("twice"));
  EXPECT_THAT(error_of("categories: {}"), HasSubstr("categories"));
  EXPECT_THAT(error_of("categoriez: {wall: [marble]}"), HasSubstr("categories"));
  EXPECT_THROW(SemanticMaterials::from_file("no/such.yaml"), InputError);
}

/// A mesh of three triangles: usemtl names and object names from the arguments, through a scene YAML with `keys`.
Scene scene_with(const std::string& keys, const TempFolder& folder) {
  folder.write("room.obj",
               "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
               "o chair_1\nusemtl paint\nf 1 2 3\n"
               "o Wall.002\nusemtl paint\nf 1 2 4\n"
               "o vegetable\nusemtl paint\nf 1 3 4\n");
  return load_scene(folder.write("scene.yaml", "mesh: room.obj\n" + keys));
}

std::vector<std::string> materials_of(const Scene& scene) {
  std::vector<std::string> names;
  for (const std::uint32_t slot : scene.mesh().triangle_material) names.push_back(scene.materials()[slot].name);
  return names;
}

TEST(SceneSemantics, CategoriesOfNodesChooseMaterials) {
  const TempFolder folder;
  EXPECT_THAT(materials_of(scene_with("", folder)), testing::ElementsAre("default", "default", "default"));
  const Scene scene = scene_with("semantics: indoor\ndefault_material: water\n", folder);
  EXPECT_THAT(materials_of(scene), testing::ElementsAre("wooden_seating", "gypsum_board", "water"));
  EXPECT_EQ(scene.materials()[scene.mesh().triangle_material[1]].category, "wall");
  EXPECT_THAT(scene.mesh().material_names, testing::Contains("paint (wall)"));
  EXPECT_THAT(materials_of(scene_with("semantics: indoor\nassign: {\"Wall*\": marble}\n", folder)),
              testing::ElementsAre("wooden_seating", "marble", "default"))
      << "patterns come before categories";
  folder.write("mine.yaml", "categories: {vegetable: [grass], chair: [marble]}\n");
  EXPECT_THAT(materials_of(scene_with("semantics: mine.yaml\n", folder)), testing::ElementsAre("marble", "default", "grass"));
  folder.write("mine.yaml", "categories: {vegetable: [gras]}\n");
  EXPECT_THAT(message_of<InputError>([&] { scene_with("semantics: mine.yaml\n", folder); }), HasSubstr("'grass'"));
}

// docs/reference/formats.md, section 2: the predecessor's `table` inside `vegetable`.
TEST(SceneSemantics, VegetableIsNoTableUnlessAskedFor) {
  const TempFolder folder;
  EXPECT_THAT(materials_of(scene_with("label_matching: exact\n", folder)), testing::ElementsAre("default", "default", "default"));
  // wood_furniture is labelled chair and table; gypsum_board wall.
  EXPECT_THAT(materials_of(scene_with("label_matching: legacy_substring\n", folder)),
              testing::ElementsAre("wood_furniture", "gypsum_board", "wood_furniture"));
}

TEST(SceneSemantics, KeysAreChecked) {
  const TempFolder folder;
  const auto error_of = [&](const std::string& keys) { return message_of<InputError>([&] { scene_with(keys, folder); }); };
  EXPECT_THAT(error_of("semantic: indoor\n"), HasSubstr("semantics"));
  EXPECT_THAT(error_of("label_matching: substring\n"), HasSubstr("legacy_substring"));
  EXPECT_THAT(error_of("coefficients: pressure\n"), HasSubstr("without `materials`"));
  EXPECT_THAT(error_of("randomize: {seeds: 1}\n"), HasSubstr("seed"));
  EXPECT_THAT(error_of("randomize: {noise_std: -0.1}\n"), HasSubstr("noise_std"));
  EXPECT_THAT(error_of("randomize: {noise_std: .nan}\n"), HasSubstr("noise_std"));
  EXPECT_THAT(error_of("randomize: {transmission_noise_db: 100}\n"), HasSubstr("transmission_noise_db"));
  EXPECT_THAT(error_of("randomize: 3\n"), HasSubstr("randomize"));
  EXPECT_THAT(error_of("semantics: missing.yaml\n"), HasSubstr("missing.yaml"));
}

// docs/evidence/oracles.md, O-15 through a scene file.
TEST(SceneSemantics, CoefficientsSayWhatAMaterialFileMeans) {
  const TempFolder folder;
  folder.write("m.json", R"({"materials": [{"name": "x", "labels": ["default"], "absorption": [125, 0.1], "scattering": [125, 1]}]})");
  const auto absorption = [&](const std::string& keys) {
    return load_scene(folder.write("s.yaml", "mesh: shoebox:1x1x1@x\nmaterials: m.json\n" + keys)).materials()[0].absorption.at(500);
  };
  EXPECT_FLOAT_EQ(absorption(""), 0.1f);
  EXPECT_FLOAT_EQ(absorption("coefficients: energy\n"), 0.1f);
  EXPECT_FLOAT_EQ(absorption("coefficients: pressure\n"), 0.19f);
}

}  // namespace
}  // namespace earshot
