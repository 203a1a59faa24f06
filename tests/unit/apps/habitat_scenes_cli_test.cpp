// SPDX-License-Identifier: Apache-2.0
// A scene of Habitat's JSON files is, for every command, the scene that is put together by hand as one file.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/base/text/json.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/files/habitat_set.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;

class HabitatScenesCli : public Cli {
 protected:
  void write_set(const HabitatSet& set) const {
    set.write([&](const std::string& name, const std::string& text) {
      std::filesystem::create_directories((folder_ / name).parent_path());
      write(name, text);
    });
  }
  [[nodiscard]] nlohmann::json surfaces_of(const std::string& scene) const {
    const CliOutcome outcome = earshot("scene " + scene + " --json " + file("s.json"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    return parse_json(read("s.json")).at("surfaces");
  }
  [[nodiscard]] std::vector<float> response(const std::string& scene, const HabitatSet& set) const {
    const CliOutcome outcome =
        earshot("rir " + scene + " --source " + point_text(set.source()) + " --listener " + point_text(set.listener()) +
                " --preset fast --channels mono --set rays=256 rir_length_s=0.3 --out " + file("x.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    return read_wav("x.wav");
  }
  [[nodiscard]] nlohmann::json picture(const std::string& scene, const HabitatSet& set) const {
    const CliOutcome outcome = earshot("render " + scene + " --sensor semantic --panorama --size 96x48 --height 0 --pose " +
                                       point_text(set.listener()) + ",0 --out " + file("x.png") + " --json " + file("x.json"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    return parse_json(read("x.json")).at("categories");
  }
};

TEST_F(HabitatScenesCli, MaterialsResponsesAndPicturesAreThoseByHand) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const HabitatSet set(200 + i);
    write_set(set);
    const std::string rules = "semantics: indoor\nassign: {own0: window_glass}\n";
    write("hand.obj", set.obj());
    const std::string control = write("hand.yaml", "mesh: hand.obj\n" + rules),
                      scene = write("scene.yaml", std::string("mesh: ") + HabitatSet::kScene + "\n" + rules);
    EXPECT_EQ(surfaces_of(scene), surfaces_of(control));
    EXPECT_EQ(response(scene, set), response(control, set)) << i;
    EXPECT_EQ(picture(scene, set), picture(control, set));
    const std::vector<float> plain = response(file("hand.obj"), set);
    EXPECT_EQ(response(file(HabitatSet::kScene), set), plain);
    EXPECT_EQ(response(file(HabitatSet::kConfig) + ",scene=apt_0", set), plain);
  }
}

TEST_F(HabitatScenesCli, WhatIsMissingOrForeignEndsInOneLine) {
  const HabitatSet set(210);
  write_set(set);
  const std::string scene = file(HabitatSet::kScene), config = file(HabitatSet::kConfig);
  expect_bad_input("scene " + config + ",scene=apt_7", "names the scene 'apt_7', which cad.scene_dataset_config.json does not list");
  expect_bad_input("scene " + scene + " --unit 0.01", "is a scene of Habitat in metres and takes no unit");
  // A handle may end as a mesh file does.
  expect_bad_input("scene " + config + ",scene=apt_0.glb --unit 0.01", "is a scene of Habitat in metres and takes no unit");
  expect_bad_input("scene " + config + ",scene=apt_0.ply --up z", "is a scene of Habitat");
  expect_bad_input("scene " + write("glb.yaml", std::string("annotations: a.house\nmesh: ") + HabitatSet::kConfig + ",scene=a.glb\n"),
                   "annotations have no effect on");
  expect_bad_input("scene " + file("configs/stages/flat.stage_config.json"), "describes a stage of Habitat; give the .scene_instance.json");
  expect_bad_input("scene " + write("up.yaml", std::string("up: z\nmesh: ") + HabitatSet::kScene + "\n"), "have no effect on");
  expect_bad_input("scene " + write("names.yaml", std::string("annotations: a.house\nmesh: ") + HabitatSet::kScene + "\n"),
                   "annotations have no effect on");
  std::map<std::string, nlohmann::json> files = set.jsons();
  files[HabitatSet::kScene]["object_instances"][1]["translation"] = {0, "NaN", 0};
  write(HabitatSet::kScene, json_text(files[HabitatSet::kScene]));
  for (const char* command : {"scene ", "rir --source 1,1,1 --listener 2,1,1 --out x.wav ", "render --pose 1,1,1,0 --out x.png "})
    expect_bad_input(command + scene, "object_instances[1].translation is not a list of three numbers");
}

}  // namespace
}  // namespace earshot
