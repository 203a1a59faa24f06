// SPDX-License-Identifier: Apache-2.0
// A scene of Habitat is the scene that is put together by hand: the same hash of geometry, names and materials.
#include "sim/scene/habitat/habitat_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <string>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/text/json.h"
#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"
#include "sim/scene/scene_inputs.h"
#include "tests/support/files/annotated_room.h"
#include "tests/support/files/habitat_set.h"
#include "tests/support/files/mutate.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

void write_set(const TempFolder& folder, const HabitatSet& set) {
  set.write([&](const std::string& name, const std::string& text) { folder.write(name, text); });
}

Scene by_hand(const TempFolder& folder, const HabitatSet& set, const std::string& more = "") {
  folder.write("hand/scene.obj", set.obj());
  return load_scene(folder.write("hand/scene.yaml", "mesh: scene.obj\n" + more));
}

/// In coordinates of the scene.
std::pair<glm::vec3, glm::vec3> box_of(const Scene& scene, const std::string& object) {
  glm::vec3 lower(1e9f), upper(-1e9f);
  for (std::size_t t = 0; t < scene.mesh().triangles.size(); ++t) {
    if (scene.mesh().object_names[scene.mesh().triangle_object[t]] != object) continue;
    for (int corner = 0; corner < 3; ++corner) {
      const glm::vec3 p = scene.to_world(scene.mesh().vertices[scene.mesh().triangles[t][corner]]);
      lower = glm::min(lower, p);
      upper = glm::max(upper, p);
    }
  }
  return {lower, upper};
}

TEST(HabitatScene, IsAsPutTogetherByHand) {
  for (std::uint32_t i = 0; i < 12; ++i) {
    const TempFolder folder;
    const HabitatSet set(i);
    write_set(folder, set);
    const std::string rules = "semantics: indoor\nassign: {own1: window_glass, \"lamp*\": brick_painted}\n";
    const Scene control = by_hand(folder, set, rules);
    const Scene scene = load_scene(folder.write("rules.yaml", std::string("mesh: ") + HabitatSet::kScene + "\n" + rules));
    EXPECT_EQ(scene.mesh().material_names, control.mesh().material_names);
    EXPECT_EQ(scene.mesh().object_names, control.mesh().object_names);
    EXPECT_EQ(scene.hash(), control.hash()) << i;
    EXPECT_EQ(scene.mesh().origin_m, control.mesh().origin_m);
    EXPECT_EQ(load_appearance(scene)->triangle_category, load_appearance(control)->triangle_category);
    const std::string config = folder / HabitatSet::kConfig;
    const std::uint64_t plain = by_hand(folder, set).hash();
    for (const std::string& spec : {folder / HabitatSet::kScene, config, config + ",scene=apt_0", config + ",scene=scenes/apt_0",
                                    config + ",scene=configs/scenes/apt_0.scene_instance.json"})
      EXPECT_EQ(load_scene(spec).hash(), plain) << spec;
  }
}

// Any turn: the positions are those of a matrix by another formula, to the spacing of floats.
TEST(HabitatScene, AnyTurnIsThatOfItsQuaternion) {
  for (std::uint32_t i = 0; i < 6; ++i) {
    const TempFolder folder;
    const HabitatSet set(40 + i, false);
    write_set(folder, set);
    const Scene scene = load_scene(folder / HabitatSet::kScene), control = by_hand(folder, set);
    ASSERT_EQ(scene.mesh().vertices.size(), control.mesh().vertices.size());
    for (std::size_t v = 0; v < scene.mesh().vertices.size(); ++v)
      EXPECT_LT(glm::length(scene.to_world(scene.mesh().vertices[v]) - control.to_world(control.mesh().vertices[v])), 4e-6);
    EXPECT_EQ(scene.mesh().triangles, control.mesh().triangles);
    EXPECT_EQ(scene.mesh().object_names, control.mesh().object_names);
  }
}

TEST(HabitatScene, OneLineSaysWhatHasNoClass) {
  for (std::uint32_t i = 0; i < 6; ++i) {
    const TempFolder folder;
    HabitatSet set(60 + i);
    set.templates[0].semantic_id = 7;
    set.templates[1].semantic_id = i % 2 == 0 ? 99 : 12;
    set.templates[2].semantic_id = i < 3 ? -1 : 12;
    write_set(folder, set);
    const Scene scene = load_scene(folder / HabitatSet::kScene);
    double all = 0, without = 0;
    int num_without = 0;
    for (const HabitatSet::Instance& one : set.instances) {
      const HabitatSet::Template& model = set.templates[one.model];
      const glm::dvec3 s = glm::abs(set.world_of(one, model.upper) - set.world_of(one, model.lower));
      const double area = 2 * (s.x * s.y + s.y * s.z + s.z * s.x);
      all += area;
      if (HabitatSet::class_of(model.semantic_id).empty()) without += area, ++num_without;
    }
    const std::vector<std::string>& warnings = scene.import_report().warnings;
    if (num_without == 0) {
      EXPECT_THAT(warnings, testing::Not(testing::Contains(HasSubstr("has no category"))));
      continue;
    }
    EXPECT_THAT(warnings,
                testing::Contains(HasSubstr(fmt::format("{:.1f} % of the area of the objects ({} of 5 objects) has no category in "
                                                        "lexicon.json",
                                                        100 * without / all, num_without))));
  }
}

// The stage carries numbers, or a mesh beside it carries colours, as the stage config says.
TEST(HabitatScene, TheStageTakesItsCategories) {
  for (std::uint32_t i = 0; i < 4; ++i) {
    const TempFolder folder;
    const AnnotatedRoom room(700 + i);
    Json stage;
    if (i % 2 == 0) {
      folder.write("assets/shown.ply", room.ply());
      folder.write("assets/names.json", room.replica_info());
      stage = {{"render_asset", "assets/shown.ply"}, {"semantic_descriptor_filename", "assets/names.json"}};
    } else {
      folder.write("assets/shown.glb", room.bare_gltf().glb());
      folder.write("assets/colored.glb", room.colored_gltf().glb());
      folder.write("assets/names.txt", room.semantic_text());
      stage = {{"render_asset", "assets/shown.glb"},
               {"semantic_asset", "assets/colored.glb"},
               {"semantic_descriptor_filename", "assets/names.txt"}};
    }
    const Json config = {{"stages", {{"configs", {{{"template_handle", "room"}, {"attributes", stage}}}}}}};
    const Scene scene = load_scene(folder.write("x.scene_dataset_config.json", json_text(config)));
    std::map<std::string, double> areas;
    for (std::uint32_t t = 0; t < scene.mesh().triangles.size(); ++t)
      areas[scene.mesh().material_names[scene.mesh().triangle_material[t]]] += static_cast<double>(scene.triangle_area_m2(t));
    EXPECT_EQ(areas.size(), room.areas_m2().size());
    for (const auto& [category, area] : room.areas_m2()) EXPECT_NEAR(areas[category], area, 1e-4 * area) << category;
  }
}

struct Damage {
  std::string file;
  Json::json_pointer place;
  Json value;
  std::string message;
};

TEST(HabitatScene, RefusesInOneLine) {
  const TempFolder folder;
  HabitatSet set(80);
  set.templates[0].is_z_up = true;
  set.templates[0].has_mass = false;
  for (HabitatSet::Instance& one : set.instances) one.axes = glm::dvec3(1), one.origin = "asset_local";
  const std::string scene = HabitatSet::kScene, config = HabitatSet::kConfig, stage = "configs/stages/flat.stage_config.json",
                    object = "configs/objects/oak_table.object_config.json";
  const auto at = [](const std::string& text) { return Json::json_pointer(text); };
  const std::string first = "/object_instances/0/";
  const std::vector<Damage> damages{
      {scene, at(first + "template_name"), "objects/oak_tabel", "does not list; is it"},
      {scene, at(first + "template_name"), 3, "template_name is not a text"},
      {scene, at(first + "template_name"), "", "object_instances[0].template_name is missing"},
      {scene, at(first + "template_name"), "able", "does not list"},
      {scene, at(first + "translation"), {1, 2}, "object_instances[0].translation is not a list of three numbers"},
      {scene, at(first + "translation"), {1, 2, "x"}, "is not a list of three numbers"},
      {scene, at(first + "translation"), {1, 2, nullptr}, "is not a list of three numbers"},
      {scene, at(first + "translation"), {1, 2, 1e12}, "translation is out of range"},
      {scene, at(first + "rotation"), {0, 0, 0, 0}, "rotation has the length 0"},
      {scene, at(first + "rotation"), {1, 1, 0, 0}, "rotation has the length 1.414"},
      {scene, at(first + "rotation"), {0, 0, 0}, "is not a list of four numbers"},
      {scene, at(first + "uniform_scale"), 0, "uniform_scale gives the scale 0"},
      {scene, at(first + "uniform_scale"), 1e300, "uniform_scale is out of range"},
      {scene, at(first + "non_uniform_scale"), {1, 0, 1}, "non_uniform_scale gives the scale 0"},
      {scene, at(first + "non_uniform_scale"), {1, 2, 1}, "of which the order has no public description"},
      {scene, at(first + "translation_origin"), "middle", "is neither COM nor asset_local"},
      {scene, at("/object_instances"), Json::object(), "object_instances is not a list"},
      {scene, at("/object_instances/1"), 4, "object_instances[1] is not an object"},
      {scene, at("/stage_instance"), "flat", "stage_instance is not an object"},
      {scene, at("/stage_instance/template_name"), "none", "names the stage 'none', which cad.scene_dataset_config.json does not list"},
      {scene, at("/semantic_scene_instance"), "other", "'other' is not among"},
      {stage, at("/render_asset"), "../../stages/gone.obj", "gone.obj, which is not a file; copy the whole data set"},
      {stage, at("/render_asset"), "../../../flat.obj", "render_asset leads out of the folder of the data set"},
      {stage, at("/render_asset"), "/tmp/flat.obj", "leads out of the folder of the data set"},
      {stage, at("/render_asset"), "../scenes/apt_0.scene_instance.json", "is not a mesh that is read"},
      {stage, at("/render_asset"), "", "render_asset is missing"},
      {stage, at("/up"), {0, 0, 0}, "up has no direction"},
      {stage, at("/up"), {0, 1, 1}, "is not at right angles"},
      {stage, at("/front"), nullptr, "front is not a list of three numbers"},
      {stage, at("/origin"), {1, 0, 0}, "origin is not zero, and its effect has no public description"},
      {stage, at("/scale"), {1, 1, 0}, "scale gives the scale 0"},
      {stage, at("/units_to_meters"), -1, "units_to_meters is out of range"},
      {stage, at("/semantic_asset"), "../../stages/gone.ply", "semantic_asset names"},
      {object, at("/COM"), {1, 0, 0}, "oak_table"},
      {object, at("/semantic_id"), 1.5, "semantic_id is not a whole number"},
      {config, at("/objects/paths/.json"), {"../elsewhere"}, "objects.paths..json leads out of the folder"},
      {config, at("/objects/paths/.json"), {"/"}, "leads out of the folder of the data set"},
      {config, at("/objects/paths/.json"), "configs", "is not a list"},
      {config, at("/objects"), 7, "objects is not an object"},
      {config, at("/stages/configs"), Json::array({Json::object()}), "stages.configs[0].template_handle is missing"},
      {"configs/ssd/lexicon.json", at("/classes/1/id"), 0, "occurs twice: 0"},
      {"configs/ssd/lexicon.json", at("/classes/1/name"), 0, "classes[1].name is not a text"},
  };
  for (const Damage& damage : damages) {
    write_set(folder, set);
    std::map<std::string, Json> files = set.jsons();
    if (damage.place.back() == "COM") files[scene]["object_instances"][0]["translation_origin"] = "COM";
    files.at(damage.file)[damage.place] = damage.value;
    for (const auto& [name, json] : files) folder.write(name, json_text(json));
    const std::string message = message_of<InputError>([&] { static_cast<void>(load_scene(folder / scene)); });
    EXPECT_THAT(message, HasSubstr(damage.message)) << damage.file << damage.place.to_string();
    EXPECT_EQ(message.find('\n'), std::string::npos);
  }
  // One of `up` and `front`, numbers that JSON has not, text that was cut off.
  write_set(folder, set);
  Json alone = set.jsons().at(stage);
  alone.erase("front");
  folder.write(stage, json_text(alone));
  EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(folder / scene)); }), HasSubstr("up is alone"));
  write_set(folder, set);
  const std::string text = json_text(set.jsons().at(scene));
  for (const auto& [broken, said] :
       {std::pair(text.substr(0, text.size() / 2), "is not JSON: error at byte"),
        {std::string(R"({"stage_instance": {"translation": [NaN, 0, 0]}})"), "is not JSON"},
        {std::string(R"({"stage_instance": {"translation": [1e999, 0, 0]}})"), "has a number that is too large"},
        {std::string("[]"), "is not a JSON object"},
        {std::string("{}"), "stage_instance is missing"}}) {
    folder.write(scene, broken);
    EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(folder / scene)); }), HasSubstr(said));
  }
  EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(folder / "none.scene_instance.json")); }), HasSubstr("none.scene"));
  folder.write("lone/a.scene_instance.json", text);
  EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(folder / "lone/a.scene_instance.json")); }),
              HasSubstr("is listed by no *.scene_dataset_config.json"));
}

// A config beside or above the data set that cannot be read stops no scene that another one lists, and is named where none does.
TEST(HabitatScene, ADamagedConfigOfAnotherSetIsPassedOver) {
  for (const char* place : {"", "set/"})
    for (const char* text : {"{", "[]", R"({"scene_instances": 5})"}) {
      const TempFolder folder;
      const HabitatSet set(3);
      set.write([&](const std::string& name, const std::string& its_text) { folder.write("set/" + name, its_text); });
      const std::string scene = folder / (std::string("set/") + HabitatSet::kScene);
      const Scene expected = load_scene(scene);
      folder.write(std::string(place) + "a.scene_dataset_config.json", text);
      EXPECT_EQ(load_scene(scene).hash(), expected.hash()) << place << text;
      const std::string lone = folder.write(std::string(place) + "lone.scene_instance.json", json_text(set.jsons().at(HabitatSet::kScene)));
      EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(lone)); }), HasSubstr("a.scene_dataset_config.json"));
    }
}

// Whatever the bytes of one file become: a scene, or one line.
TEST(HabitatScene, DamagedFilesAreRefusedOrRead) {
  const TempFolder folder;
  const HabitatSet set(85);
  write_set(folder, set);
  const std::string spec = folder / HabitatSet::kConfig + ",scene=apt_0";
  int num_refused = 0;
  std::uint32_t number = 0;
  for (const auto& [name, json] : set.jsons()) {
    const std::string text = json_text(json);
    for (int i = 0; i < 150; ++i) {
      folder.write(name, mutated(text, number++));
      const std::string message = message_of<InputError>([&] {
        const HabitatScene scene = read_habitat_scene(spec);
        if (scene.descriptor) static_cast<void>(read_classes(*scene.descriptor));
      });
      EXPECT_EQ(message.find_first_of("\n\r"), std::string::npos) << message;
      num_refused += !message.empty();
    }
    folder.write(name, text);
  }
  EXPECT_GT(num_refused, 300);
}

TEST(HabitatScene, HandlesAreWholeComponents) {
  const TempFolder folder;
  HabitatSet set(90);
  set.templates[2].semantic_id = -1;
  write_set(folder, set);
  std::map<std::string, Json> files = set.jsons();
  const std::string config = HabitatSet::kConfig, scene = HabitatSet::kScene;
  // The same name in two folders is two objects; a path tells them apart.
  folder.write("configs/obj_more/lamp.object_config.json", json_text(files.at("configs/objects/lamp.object_config.json")));
  EXPECT_EQ(load_scene(folder / scene).hash(), by_hand(folder, set).hash());  // "objects/lamp" is one of them alone
  files[scene]["object_instances"][0]["template_name"] = "lamp";
  folder.write(scene, json_text(files[scene]));
  EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(folder / scene)); }),
              testing::AllOf(HasSubstr("'lamp' is the object"), HasSubstr("write the whole path")));
  // A copy with other attributes, and a mesh without a config.
  files = set.jsons();
  files[config]["objects"]["paths"][".obj"] = {"objects/*.obj"};
  files[config]["objects"]["configs"] = {{{"original_file", "configs/objects/lamp.object_config.json"},
                                          {"template_handle", "big_lamp"},
                                          {"attributes", {{"scale", {4, 4, 4}}}}}};
  files[scene]["object_instances"] = {
      {{"template_name", "big_lamp"}, {"translation_origin", "asset_local"}},
      {{"template_name", "objects/lamp.obj"}, {"translation", {0, 9, 0}}, {"translation_origin", "asset_local"}}};
  for (const auto& [name, json] : files) folder.write(name, json_text(json));
  const Scene two = load_scene(folder / scene);
  const HabitatSet::Template& lamp = set.templates[2];
  const glm::dvec3 size = lamp.upper - lamp.lower;
  const auto [lower, upper] = box_of(two, "big_lamp_0");
  EXPECT_FLOAT_EQ(upper.x - lower.x, static_cast<float>(4 * lamp.unit * size.x));
  const auto [plain_lower, plain_upper] = box_of(two, "lamp_1");
  EXPECT_FLOAT_EQ(plain_lower.y, static_cast<float>(9 + lamp.lower.y));
  EXPECT_FLOAT_EQ(plain_upper.x - plain_lower.x, static_cast<float>(size.x));
  // Several scenes need a name.
  folder.write("configs/scenes/apt_1.scene_instance.json", json_text(files[scene]));
  EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(folder / config)); }),
              testing::AllOf(HasSubstr("lists 2 scenes: configs/scenes/apt_0, configs/scenes/apt_1"), HasSubstr(",scene=")));
  EXPECT_NO_THROW(static_cast<void>(load_scene(folder / config + ",scene=apt_1")));
  EXPECT_NO_THROW(static_cast<void>(load_scene(folder / config + ",scene=flat")));  // the stage alone
  folder.write("other.scene_dataset_config.json", json_text(files[config]));
  EXPECT_THAT(message_of<InputError>([&] { static_cast<void>(load_scene(folder / scene)); }), HasSubstr("is listed by"));
}

TEST(HabitatScene, LinesSayWhatIsLeftOut) {
  const TempFolder folder;
  const HabitatSet set(95);
  write_set(folder, set);
  std::map<std::string, Json> files = set.jsons();
  const std::string scene = HabitatSet::kScene;
  files[scene]["articulated_object_instances"] = {{{"template_name", "fridge"}}, {{"template_name", "door"}}};
  files[scene]["surprise"] = 1;
  files["configs/stages/flat.stage_config.json"]["semantic_asset"] = "%%CONFIG_NAME_AS_ASSET_FILENAME%%.semantic.glb";
  for (const auto& [name, json] : files) folder.write(name, json_text(json));
  EXPECT_THAT(load_scene(folder / scene).import_report().warnings,
              testing::IsSupersetOf({HasSubstr("2 articulated objects are left out, as their URDF is not read: fridge, door"),
                                     HasSubstr("1 unknown keys have no effect: 'surprise' in apt_0.scene_instance.json"),
                                     HasSubstr("names with %% have no public description")}));
}

TEST(HabitatScene, InputsAreAllFiles) {
  const TempFolder folder;
  HabitatSet set(97);
  set.templates[0].semantic_id = 7;
  write_set(folder, set);
  const std::string spec = folder / HabitatSet::kScene;
  const auto before = hash_of_scene_inputs(spec);
  ASSERT_TRUE(before);
  const auto files = files_of_scene(spec);
  ASSERT_TRUE(files);
  for (const char* name : {HabitatSet::kConfig, HabitatSet::kScene, "configs/stages/flat.stage_config.json", "configs/ssd/lexicon.json",
                           "configs/objects/lamp.object_config.json", "objects/lamp.obj", "stages/flat.obj"}) {
    EXPECT_THAT(*files, testing::Contains(folder / name));
    std::ofstream(folder / name, std::ios::app) << '\n';
    EXPECT_NE(hash_of_scene_inputs(spec), before) << name;
    write_set(folder, set);
    EXPECT_EQ(hash_of_scene_inputs(spec), before) << name;
  }
}

// Two meshes with one material name and two colours: each object shows its own, where it stands.
TEST(HabitatScene, EachObjectHasItsOwnColor) {
  const TempFolder folder;
  HabitatSet set(98);
  set.has_looks = true;
  for (HabitatSet::Template& model : set.templates) model.material = "paint", model.semantic_id = -1;
  write_set(folder, set);
  const std::array<glm::vec3, 3> colors{glm::vec3(1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, 0, 1)};
  for (std::size_t i = 0; i < 3; ++i) {
    const HabitatSet::Template& model = set.templates[i];
    folder.write("objects/" + model.name + ".mtl", fmt::format("newmtl paint\nKd {} {} {}\n", colors[i].x, colors[i].y, colors[i].z));
  }
  const Scene scene = load_scene(folder / HabitatSet::kScene);
  const auto appearance = load_appearance(scene);
  ASSERT_TRUE(appearance->detail);
  const VisualMesh& looks = appearance->detail->mesh;
  ASSERT_EQ(looks.triangles.size(), 12 * (1 + set.instances.size()));
  for (std::size_t i = 0; i < set.instances.size(); ++i) {
    const HabitatSet::Template& model = set.templates[set.instances[i].model];
    glm::vec3 lower(1e9f), upper(-1e9f);
    for (std::size_t t = 12 * (i + 1); t < 12 * (i + 2); ++t) {
      EXPECT_EQ(looks.paints[looks.triangle_paint[t]].base_color, colors[set.instances[i].model]);
      for (int c = 0; c < 3; ++c) {
        lower = glm::min(lower, glm::vec3(scene.to_world(looks.vertices[looks.triangles[t][c]])));
        upper = glm::max(upper, glm::vec3(scene.to_world(looks.vertices[looks.triangles[t][c]])));
      }
    }
    const auto [expected_lower, expected_upper] = box_of(scene, fmt::format("{}_{}", model.name, i));
    EXPECT_LT(glm::length(lower - expected_lower), 2e-6f);  // floats in coordinates of the asset
    EXPECT_LT(glm::length(upper - expected_upper), 2e-6f);
  }
}

}  // namespace
}  // namespace earshot
