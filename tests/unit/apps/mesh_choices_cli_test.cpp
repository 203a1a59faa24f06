// SPDX-License-Identifier: Apache-2.0
// Unit and up axis of a mesh file travel with its name, so that every command reads it alike.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/text/json.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;

class MeshChoicesCli : public Cli {
 protected:
  /// A room without furniture in a drawn unit and axis, and the choices that read it.
  [[nodiscard]] DrawnRoom drawn(std::uint32_t number) const {
    DrawnRoom room(300 + number);
    room.size = {5 + 0.1 * (number % 7), 2.6, 4 + 0.1 * (number % 5)};
    return room;
  }
  [[nodiscard]] static std::string choices(const DrawnRoom& room) {
    return fmt::format(",unit={},up={}", room.unit_m, room.is_z_up ? "z" : "y");
  }
  [[nodiscard]] double volume_m3(const std::string& scene) const {
    const CliOutcome outcome = earshot("scene " + scene + " --json " + file("s.json"));
    EXPECT_EQ(outcome.exit_code, 0) << scene << "\n" << outcome.errors;
    return outcome.exit_code == 0 ? parse_json(read("s.json")).at("volume_m3").get<double>() : 0;
  }
  void expect_refused(const std::string& arguments, const std::string& text) const {
    const CliOutcome outcome = earshot(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments;
    EXPECT_THAT(outcome.errors, HasSubstr(text)) << arguments;
  }
};

TEST_F(MeshChoicesCli, TheNameOfASceneCarriesThem) {
  for (std::uint32_t i = 0; i < 10; ++i) {
    const DrawnRoom room = drawn(i);
    const std::string mesh = write("room.obj", room.obj());
    const double expected_m3 = room.size.x * room.size.y * room.size.z;
    EXPECT_NEAR(volume_m3(mesh + room.flags()), expected_m3, 0.02 * expected_m3);
    EXPECT_NEAR(volume_m3(mesh + choices(room)), expected_m3, 0.02 * expected_m3);
  }
}

// Episodes name the scene as it is to be read: evaluation and training find the same room.
TEST_F(MeshChoicesCli, EpisodesAndCorporaKeepThem) {
  for (std::uint32_t i = 0; i < 3; ++i) {
    const DrawnRoom room = drawn(20 + i);
    const std::string mesh = write("room.obj", room.obj());
    const CliOutcome outcome =
        earshot("dataset episodes " + mesh + room.flags() +
                " --count 2 --set data.train.filter.min_geodesic_m=0.5 data.train.filter.min_ratio=1 --out " + file("e.json"));
    ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
    const std::string scene = parse_json(read("e.json")).at("episodes").at(0).at("scene_id").get<std::string>();
    EXPECT_THAT(scene, HasSubstr("unit="));
    const double expected_m3 = room.size.x * room.size.y * room.size.z;
    EXPECT_NEAR(volume_m3(scene), expected_m3, 0.02 * expected_m3) << scene;
    const CliOutcome eval = earshot("eval oracle --episodes " + file("e.json") + " --out " + file("r" + std::to_string(i) + ".json"));
    EXPECT_EQ(eval.exit_code, 0) << eval.errors;

    const std::string corpus = file("c" + std::to_string(i));
    const CliOutcome pano =
        earshot("dataset pano " + mesh + room.flags() + " --pairs 1 --size 24x8 --rate 16000 --length 0.1 --out " + corpus);
    ASSERT_EQ(pano.exit_code, 0) << pano.errors;
    const auto line = parse_json(read("c" + std::to_string(i) + "/manifest.jsonl"));
    EXPECT_EQ(line.at("scene").get<std::string>(), scene);
    for (int axis = 0; axis < 3; ++axis) {
      const double at_m = line.at("source").at("position_m").at(static_cast<std::size_t>(axis)).get<double>() - room.lower[axis];
      EXPECT_GT(at_m, 0) << axis;
      EXPECT_LT(at_m, room.size[axis]) << axis;
    }
  }
}

TEST_F(MeshChoicesCli, WhatHasNoMeaningIsRefused) {
  const DrawnRoom room = drawn(40);
  const std::string mesh = write("room.obj", room.obj());
  expect_refused("scene " + mesh + ",unit=0", "has the unit '0'");
  expect_refused("scene " + mesh + ",unit=1e9", "has the unit '1e9'");
  expect_refused("scene " + mesh + ",up=x", "has the up axis 'x'");
  expect_refused("scene " + mesh + ",axis=z", "has 'axis=z' after the file");
  expect_refused("scene " + mesh + ",up=z,up=z", "each once");
  expect_refused("scene " + mesh + ",up=z --up z", "give it once");
  expect_refused("dataset episodes house:3 --up z --out " + file("e.json"), "is not a mesh file");
  expect_refused("bench rir --quick --up z", "no SCENE is given");
  expect_refused("bench env --quick --unit 0.01", "is not a mesh file");
}

TEST_F(MeshChoicesCli, AFileWithACommaIsThatFile) {
  const DrawnRoom room = drawn(50);
  const std::string mesh = write("room.obj,up=q.obj", room.obj());
  const double expected_m3 = room.size.x * room.size.y * room.size.z;
  EXPECT_NEAR(volume_m3(mesh + room.flags()), expected_m3, 0.02 * expected_m3);
}

}  // namespace
}  // namespace earshot
