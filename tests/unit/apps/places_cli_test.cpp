// SPDX-License-Identifier: Apache-2.0
// Places of sources and listeners that cannot be meant are refused by every command, and those that can are not.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/files/drawn_room.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* kQuick = " --preset fast --channels mono --set rays=32 rir_length_s=0.2 --out ";

class PlacesCli : public Cli {
 protected:
  /// Exit code 2, one line that says which place is outside, and nothing written.
  void expect_outside(const std::string& arguments, const std::string& place) const {
    expect_bad_input(arguments, "outside");
    EXPECT_THAT(read("stderr"), HasSubstr(place)) << arguments;
    EXPECT_FALSE(std::filesystem::exists(file("x.wav"))) << arguments;
  }
  void expect_heard(const std::string& arguments) const {
    const CliOutcome outcome = earshot(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.errors;
    EXPECT_THAT(outcome.errors, Not(HasSubstr("outside"))) << arguments;
  }
  [[nodiscard]] std::string walk(const std::string& scene, const std::string& poses) const {
    return "walk " + scene + " --poses " + write("poses.csv", "t_s,x,y,z,heading_deg\n" + poses) + " --sound synth:noise --step 0.1" +
           kQuick + file("x.wav");
  }
};

TEST_F(PlacesCli, APlaceOutsideAShoeboxIsRefused) {
  const std::string rir = "rir shoebox:5x3x4@0.2" + (kQuick + file("x.wav"));
  expect_outside(rir + " --source 1,1,1 --listener 12,1,1", "listener 12,1,1");
  expect_outside(rir + " --source 1,1,-2 --listener 2,1,1", "source 1,1,-2");
  expect_outside(rir + " --source 1,1,1 --listener 380,160,230", "if it was meant in centimetres, it is 3.8,1.6,2.3, inside");
  expect_outside(rir + " --source 1,1,1 --listener 2,-3,1.5", "if it was meant with z up, it is 2,1.5,3, inside");
  expect_outside(rir + " --source 1,1,1 --listener 2,1,1 --listener 2,1,9", "listener 2,1,9");  // the second of two
  expect_outside(walk("shoebox:5x3x4@0.2", "0,1,1.5,1,0\n0.3,1,1.5,2,0\n") + " --source 4,1.5,9", "source at 0 s, 4,1.5,9");
  expect_outside(walk("shoebox:5x3x4@0.2", "0,1,1.5,1,0\n0.5,9,1.5,1,0\n") + " --source 4,1.5,1", "listener at 0.3 s, 5.8,1.5,1");
}

// Rooms of the test's own at random places, in random units and axes: inside nothing is said, outside the place is named.
TEST_F(PlacesCli, APlaceOutsideAnyClosedMeshIsRefused) {
  for (std::uint32_t i = 0; i < 12; ++i) {
    const DrawnRoom room(i);
    const std::string scene = write("room.obj", room.opaque_obj()) + room.flags(), out = kQuick + file("x.wav");
    const std::string a = point_text(room.inside(0)), b = point_text(room.inside(1)), away = point_text(room.outside(2));
    expect_heard("rir " + scene + out + " --source " + a + " --listener " + b);
    std::filesystem::remove(file("x.wav"));
    expect_outside("rir " + scene + out + " --source " + a + " --listener " + away, "listener");
    expect_outside("rir " + scene + out + " --source " + away + " --listener " + a, "source");
    expect_outside(walk(scene, "0," + a + ",0\n0.3," + b + ",0\n") + " --source " + away, "source at 0 s");
    expect_outside(walk(scene, "0," + a + ",0\n0.3," + away + ",0\n") + " --source " + b, "listener at");
  }
}

// A window of 10 to 60 cm in a wall lets sound out, wherever both places are.
TEST_F(PlacesCli, ARoomWithAnyOpeningIsNotClosed) {
  for (std::uint32_t i = 20; i < 30; ++i) {
    DrawnRoom room(i);
    room.unit_m = 1;
    room.is_z_up = false;
    const double width_m = 0.1 + 0.5 * room.draw(200);
    const glm::dvec3 low = room.lower, high = room.lower + room.size;
    const double x0 = low.x + (room.size.x - width_m) * room.draw(201), y0 = low.y + (room.size.y - width_m) * room.draw(202);
    std::string text = room.obj({"a", "b", "c", "d", "", "f"});
    int corners = 8;
    const auto pane = [&](double left, double right, double bottom, double top) {
      text += fmt::format("v {0} {2} {4}\nv {1} {2} {4}\nv {1} {3} {4}\nv {0} {3} {4}\nf {5} {6} {7} {8}\n", left, right, bottom, top,
                          low.z, corners + 1, corners + 2, corners + 3, corners + 4);
      corners += 4;
    };
    pane(low.x, x0, low.y, high.y);
    pane(x0 + width_m, high.x, low.y, high.y);
    pane(x0, x0 + width_m, low.y, y0);
    pane(x0, x0 + width_m, y0 + width_m, high.y);
    const glm::dvec3 out_there(low.x + 0.5 * room.size.x, low.y + 1.2, high.z + 2);  // behind the wall opposite to the window
    expect_heard("rir " + write("room.obj", text) + kQuick + file("x.wav") + " --source " + point_text(room.inside(0)) + " --listener " +
                 point_text(out_there));
  }
}

// Free fields, open rooms, places inside furniture and in courtyards are legal.
TEST_F(PlacesCli, WhatCanBeMeantIsNotRefused) {
  const std::string out = kQuick + file("x.wav");
  expect_heard("rir " + write("ground.obj", "v -50 0 -50\nv 50 0 -50\nv 0 0 80\nf 1 2 3\n") + out + " --source 0,1,0 --listener 5,2,1");
  expect_heard("rir " + write("speck.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n") + out + " --source 90,1,0 --listener 95,2,1");
  for (std::uint32_t i = 40; i < 50; ++i) {
    DrawnRoom room(i);
    const std::string open = write("open.obj", room.obj({"a", "b", "c", "", "e", "f"})) + room.flags();
    const glm::dvec3 above = room.lower + room.size * glm::dvec3(0.5, 1.4, 0.5), beside = room.outside(2);
    expect_heard("rir " + open + out + " --source " + point_text(room.inside(0)) + " --listener " + point_text(above));
    expect_heard("rir " + open + out + " --source " + point_text(beside) + " --listener " + point_text(above));

    DrawnRoom cupboard(i);  // a closed box on the floor of a closed room, the source inside
    cupboard.lower = room.lower + room.size * glm::dvec3(0.6, 0.02, 0.6);
    cupboard.size = 0.3 * room.size;
    std::string both = room.opaque_obj(), thing = cupboard.opaque_obj();
    for (std::size_t at = thing.find("f "); at != std::string::npos; at = thing.find("f ", at + 2)) {
      const std::size_t end = thing.find('\n', at);
      int a = 0, b = 0, c = 0, d = 0;
      std::sscanf(thing.substr(at, end - at).c_str(), "f %d %d %d %d", &a, &b, &c, &d);
      thing.replace(at, end - at, fmt::format("f {} {} {} {}", a + 8, b + 8, c + 8, d + 8));
    }
    expect_heard("rir " + write("cupboard.obj", both + thing) + room.flags() + out + " --source " +
                 point_text(cupboard.lower + 0.5 * cupboard.size) + " --listener " + point_text(room.lower + 0.3 * room.size));
  }
}

TEST_F(PlacesCli, ACourtyardIsOutsideOfItsBuildingOnly) {
  SKIP_WITHOUT_DATA("field/c08_courtyard.obj");
  const std::string rir = "rir " + (data_folder() / "field/c08_courtyard.obj").string() + kQuick + file("x.wav");
  expect_heard(rir + " --source 5,1.5,4 --listener 7,1.5,5");
  expect_heard(rir + " --source 1,1.5,4 --listener 11,1.5,5");
  std::filesystem::remove(file("x.wav"));
  expect_outside(rir + " --source 1,1.5,4 --listener 7,1.5,5", "listener 7,1.5,5");
}

// Where walls let sound through, a place outside is heard, and said to be outside.
// Of half of the rooms one wall alone lets sound through, whether or not the straight line meets it: what passes it is reflected on.
TEST_F(PlacesCli, WhatWallsLetThroughIsHeardWithAWarning) {
  write("db.json", R"({"materials": [
      {"name": "brick", "labels": ["default"], "absorption": [1000, 0.2], "scattering": [1000, 0.1], "source": "a test"},
      {"name": "panel", "absorption": [1000, 0.2], "scattering": [1000, 0.1], "transmission": [1000, 0.05], "source": "a test"}]})");
  for (std::uint32_t i = 60; i < 70; ++i) {
    const DrawnRoom room(i);
    write("room.obj", room.opaque_obj());
    const std::string walls = i % 2 == 0 ? "*" : std::string(1, static_cast<char>('a' + i % 6));
    const std::string scene = write("room.yaml", "mesh: room.obj\nmaterials: db.json\nassign: {\"" + walls + "\": panel}\n") + room.flags();
    const CliOutcome outcome =
        earshot("rir " + scene + kQuick + file("x.wav") + " --set transmission=on --source " + point_text(room.inside(0)) + " --listener " +
                point_text(room.outside(1)) + " --metrics " + file("x.json"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr("only sound through walls"));
    EXPECT_THAT(read("x.json"), HasSubstr("only sound through walls"));
  }
}

TEST_F(PlacesCli, TwoPlacesOutsideAClosedRoomAreSaidToBe) {
  for (std::uint32_t i = 80; i < 90; ++i) {
    const DrawnRoom room(i);
    const CliOutcome outcome = earshot("rir " + write("room.obj", room.opaque_obj()) + room.flags() + kQuick + file("x.wav") +
                                       " --source " + point_text(room.outside(0)) + " --listener " + point_text(room.outside(1)));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr("both lie outside")) << i;
  }
}

}  // namespace
}  // namespace earshot
