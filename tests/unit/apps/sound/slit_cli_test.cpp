// SPDX-License-Identifier: Apache-2.0
// Levels behind a wall that is nearly closed, as `earshot rir` gives them with a field and by paths.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>

#include "tests/support/acoustics/divided_room.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

using slits::DividedRoom;

class SlitCli : public Cli {
 protected:
  /// Decibels of the late part by `settings`.
  [[nodiscard]] double late_db(const std::string& scene, const std::string& settings) const {
    const CliOutcome outcome = earshot("rir " + scene + " --preset fast --channels mono --source 1.1,1.4,-1.2 --listener 5,1.5,-1.95" +
                                       " --components --out " + file("r.wav") + " --set rir_length_s=1 diffraction=off " + settings);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    double energy = 0;
    for (const float sample : read_wav("r.late.wav")) energy += double{sample} * double{sample};
    return 10 * std::log10(energy);
  }
  [[nodiscard]] std::string write_obj(const DividedRoom& room, const std::string& name) const {
    const TriangleMesh mesh = room.mesh();
    std::string text;
    for (const glm::vec3 v : mesh.vertices) text += fmt::format("v {:.9g} {:.9g} {:.9g}\n", v.x, v.y, v.z);
    for (const glm::uvec3 t : mesh.triangles) text += fmt::format("f {} {} {}\n", t.x + 1, t.y + 1, t.z + 1);
    return write(name, text);
  }
  /// So many photons that little of the difference is theirs; paths know their level within 0.2 dB.
  void expect_levels_of_paths(std::uint32_t number, DividedRoom::Door door) const {
    auto [room, cell_m] = DividedRoom::drawn(number);
    room.door = door;
    room.gap_m = door == DividedRoom::Door::ajar ? 0.03 : 0.02;
    const std::string scene = write_obj(room, "room.obj");
    const double paths_db = late_db(scene, "field=off rays=16384 source_rays=16384 source_bounces=30");
    const double field_db = late_db(scene, fmt::format("field=on field_photons=65536 field_error=0.001 field_cell_m={}", cell_m));
    std::printf("wall %u, cells of %.1f m: %+.1f dB\n", number, static_cast<double>(cell_m), field_db - paths_db);
    EXPECT_NEAR(field_db, paths_db, 3.0) << "wall " << number << ", cells of " << cell_m << " m";
  }
};

// Three of the walls that tests draw, with cells of 0.6, 0.6 and 0.5 m that lie across them, and doors of both kinds.
TEST_F(SlitCli, AFieldIsAsLoudAsPathsBehindAWall) {
  expect_levels_of_paths(16, DividedRoom::Door::over_a_slit);
  expect_levels_of_paths(20, DividedRoom::Door::ajar);
  expect_levels_of_paths(25, DividedRoom::Door::over_a_slit);
}

TEST_F(SlitCli, ItIsBehindTheOtherDoorOfEachWall) {
  expect_levels_of_paths(16, DividedRoom::Door::ajar);
  expect_levels_of_paths(20, DividedRoom::Door::over_a_slit);
  expect_levels_of_paths(25, DividedRoom::Door::ajar);
}

}  // namespace
}  // namespace earshot
