// SPDX-License-Identifier: Apache-2.0
// What may not be meant about a scene is said once, by every command that takes one; what is given is not guessed.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/base/text/json.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::Not;

class SceneWarningsCli : public Cli {
 protected:
  /// What `scene` says of a scene, in its output and its JSON.
  [[nodiscard]] std::vector<std::string> said_by_scene(const std::string& scene) const {
    const CliOutcome outcome = earshot("scene " + scene + " --json " + file("s.json"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    return {outcome.output, parse_json(read("s.json")).at("warnings").dump()};
  }
  /// What `scene`, `rir`, `walk` and `render` say of a scene, each in its place; source and listener in metres.
  [[nodiscard]] std::vector<std::string> said_of(const std::string& scene, glm::dvec3 source, glm::dvec3 listener) const {
    const std::string out = file("x.wav") + " --preset fast --channels mono --set rays=16 rir_length_s=0.1";
    std::vector<std::string> said = said_by_scene(scene);
    const auto add = [&](const std::string& arguments) {
      const CliOutcome outcome = earshot(arguments);
      EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.errors;
      said.push_back(outcome.errors);
    };
    add("rir " + scene + " --source " + point_text(source) + " --listener " + point_text(listener) + " --out " + out + " --metrics " +
        file("m.json"));
    said.push_back(parse_json(read("m.json")).at("warnings").dump());
    add("walk " + scene + " --sound synth:noise --step 0.1 --source " + point_text(source) + " --poses " +
        write("p.csv", "0," + point_text(listener) + ",0\n0.2," + point_text(listener) + ",0\n") + " --out " + out);
    add("render " + scene + " --sensor depth --size 16x16 --pose " + point_text(listener) + ",0 --out " + file("x.png"));
    return said;
  }
  void expect_all_say(const std::vector<std::string>& said, const std::string& text) const {
    for (std::size_t i = 0; i < said.size(); ++i) EXPECT_THAT(said[i], HasSubstr(text)) << i;
  }
  void expect_none_says(const std::vector<std::string>& said, const std::string& text) const {
    for (std::size_t i = 0; i < said.size(); ++i) EXPECT_THAT(said[i], Not(HasSubstr(text))) << i;
  }
};

// A room with the names of its surfaces, read as it is meant: nothing to say.
TEST_F(SceneWarningsCli, ARoomThatIsMeantSaysNothing) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const DrawnRoom room(100 + i);
    const std::string scene = write("room.obj", room.obj()) + room.flags();
    const std::vector<std::string> said = said_of(scene, room.inside(0), room.inside(1));
    for (const std::size_t stderr_of : {2, 4, 5}) EXPECT_EQ(said[stderr_of], "") << stderr_of;
    EXPECT_EQ(said[1], "[]");
    EXPECT_EQ(said[3], "[]");
  }
}

TEST_F(SceneWarningsCli, AnOpenMeshWarnsEverywhere) {
  for (std::uint32_t i = 0; i < 10; ++i) {
    const DrawnRoom room(120 + i);
    std::array<std::string, 6> names{"wall", "wall", "floor", "ceiling", "wall", "wall"};
    const std::array<std::size_t, 5> removable{0, 1, 3, 4, 5};
    names[removable[i % 5]] = "";
    expect_all_say(said_of(write("room.obj", room.obj(names)) + room.flags(), room.inside(0), room.inside(1)),
                   "% of the rays leave the scene");
  }
}

// Names of floors and ceilings tell the axis; the size tells the unit.  What is given is not guessed.
TEST_F(SceneWarningsCli, AWrongAxisOrUnitIsGuessed) {
  for (std::uint32_t i = 0; i < 10; ++i) {
    DrawnRoom room(140 + i);
    room.lower = glm::dvec3(0);
    room.is_z_up = true;
    room.unit_m = 1;
    const glm::dvec3 a = room.to_file(room.inside(0)), b = room.to_file(room.inside(1));
    const std::string scene = write("room.obj", room.obj());
    expect_all_say(said_of(scene, a, b), "up axis of the mesh is probably z");
    expect_none_says(said_by_scene(scene + " --up z"), "up axis of the mesh is probably");
    expect_none_says(said_by_scene(scene + " --up y"), "up axis of the mesh is probably");

    const std::array<double, 3> units{0.01, 0.001, 0.0254};
    room.is_z_up = false;
    room.unit_m = units[i % 3];
    const std::string other = write("unit.obj", room.obj());
    const std::vector<std::string> said = said_of(other, room.to_file(room.inside(0)), room.to_file(room.inside(1)));
    for (const std::string& text : said)
      EXPECT_THAT(text, testing::AnyOf(HasSubstr("unit of the mesh is probably"), HasSubstr("is the unit right?")));
    EXPECT_NEAR(parse_json(read("s.json")).at("axes").at("unit_guess_m").get<double>(), room.unit_m, 1e-9) << room.unit_m;
    expect_none_says({said_by_scene(other + fmt::format(" --unit {}", room.unit_m))[1]}, "unit");
  }
}

TEST_F(SceneWarningsCli, AMeshThatEnclosesNextToNothingWarns) {
  expect_all_say(said_of(write("one.obj", "v 0 0 0\nv 5 0 0\nv 0 3 0\nf 1 2 3\n"), {1, 1, 1}, {2, 1, 1}), "encloses no air");
  DrawnRoom box(160);
  box.unit_m = 1;
  box.is_z_up = false;
  box.size = {0.8, 0.7, 0.9};
  expect_all_say(said_of(write("box.obj", box.obj()), box.inside(0), box.inside(1)), "m3 of air");
}

TEST_F(SceneWarningsCli, SurfacesWithoutAMaterialAreCountedAndNamed) {
  for (std::uint32_t i = 0; i < 10; ++i) {
    const DrawnRoom room(180 + i);
    std::array<std::string, 6> names{"wall", "wall", "floor", "ceiling", "wall", "wall"};
    const std::string odd = "Xq_" + std::to_string(i);
    names[i % 6] = odd;
    write("room.obj", "mtllib gone.mtl\n" + room.obj(names));
    const std::vector<std::string> said = said_of(file("room.obj") + room.flags(), room.inside(0), room.inside(1));
    expect_all_say(said, "no material is assigned for 1 of ");
    expect_all_say(said, "'" + odd + "'");
    expect_all_say(said, "material libraries are missing (gone.mtl)");
    expect_all_say(said_by_scene(write("room.yaml", "mesh: room.obj\nsemantics: indoor\n") + room.flags()),
                   "no semantic category was found for 1 of ");
    expect_none_says(said_by_scene(write("room.yaml", "mesh: room.obj\nassign: {\"" + odd + "\": brick_rough}\n") + room.flags()),
                     "no material is assigned");
  }
}

TEST_F(SceneWarningsCli, SceneSaysWhyASurfaceHasItsMaterial) {
  DrawnRoom room(200);
  room.unit_m = 1;
  room.is_z_up = false;
  write("room.obj", room.obj({"wall", "Panel", "floor", "ceiling", "Xq_1", "wall"}));
  const std::string scene = write("room.yaml", "mesh: room.obj\nsemantics: indoor\nassign: {\"Pan*\": wood_door}\n");
  ASSERT_EQ(earshot("scene " + scene + " --json " + file("s.json")).exit_code, 0);
  std::map<std::string, std::string> why;
  double area_m2 = 0;
  const nlohmann::json report = parse_json(read("s.json"));
  for (const nlohmann::json& surface : report.at("surfaces")) {
    why[surface.at("name").get<std::string>()] = surface.at("why").get<std::string>();
    area_m2 += surface.at("area_m2").get<double>();
  }
  EXPECT_EQ(why.at("Panel"), "assign.Pan*");
  EXPECT_EQ(why.at("floor"), "category floor");
  EXPECT_EQ(why.at("Xq_1"), "default: no material is assigned");
  const glm::dvec3 s = room.size;
  EXPECT_NEAR(area_m2, 2 * (s.x * s.y + s.y * s.z + s.z * s.x), 1e-3);
  EXPECT_THAT(read("stdout"), HasSubstr("assign.Pan*"));
}

}  // namespace
}  // namespace earshot
