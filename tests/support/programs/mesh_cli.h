// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "sim/base/text/json.h"
#include "tests/support/files/random_rooms.h"
#include "tests/support/files/test_data.h"
#include "tests/support/programs/cli.h"

namespace earshot {

/// Mesh files through the program.
class MeshCli : public Cli {
 protected:
  static constexpr std::uint32_t kRooms = 10;

  [[nodiscard]] nlohmann::json scene(const std::string& mesh) const {
    const CliOutcome outcome = earshot("scene " + mesh + " --json " + file("scene.json"));
    EXPECT_EQ(outcome.exit_code, 0) << mesh << "\n" << outcome.errors;
    return outcome.exit_code == 0 ? parse_json(read("scene.json")) : nlohmann::json::object();
  }
  /// Triangles as the file has them.  A box fills its bounds, so that the volume that `scene` samples is exact to the rounding of floats.
  void expect_room(const std::string& mesh, std::uint64_t triangles, double volume_m3, double tolerance = 1e-4) const {
    const nlohmann::json report = scene(mesh);
    if (report.empty()) return;
    EXPECT_EQ(report.at("triangles"), triangles) << mesh;
    EXPECT_NEAR(report.at("volume_m3").get<double>(), volume_m3, tolerance * volume_m3) << mesh;
  }
  void expect_room(const std::string& mesh, const random_rooms::Room& room) const { expect_room(mesh, 12, room.volume_m3()); }
  /// A response between two points of the room: exit code 0 and a sound.
  void expect_response(const std::string& mesh, const random_rooms::Room& room) const {
    expect_response(mesh, room.lower + 0.3 * room.size_m, room.lower + 0.7 * room.size_m);
  }
  void expect_response(const std::string& mesh, glm::dvec3 source, glm::dvec3 listener) const {
    const CliOutcome outcome = earshot(response_command(mesh, source, listener));
    EXPECT_EQ(outcome.exit_code, 0) << mesh << "\n" << outcome.errors;
    if (outcome.exit_code != 0) return;
    const std::vector<float> samples = read_wav("out.wav");
    EXPECT_TRUE(std::any_of(samples.begin(), samples.end(), [](float sample) { return sample != 0; })) << mesh;
  }
  /// The quickest settings: what is read of the mesh is the same at all.
  [[nodiscard]] std::string response_command(const std::string& mesh, glm::dvec3 source, glm::dvec3 listener) const {
    return fmt::format("rir {} --preset fast --channels mono --source {},{},{} --listener {},{},{} --out {}", mesh, source.x, source.y,
                       source.z, listener.x, listener.y, listener.z, file("out.wav"));
  }
  /// The files of the field: 12 triangles and 60 m3, 5 x 3 x 4 m, unless said otherwise.
  void expect_field_file(const std::string& name, std::uint64_t triangles = 12, double volume_m3 = 60) const {
    const std::string mesh = (data_folder() / "field" / name).string();
    expect_room(mesh, triangles, volume_m3);
    expect_response(mesh, {1.5, 1.2, 1.5}, {3.5, 1.5, 2.5});
  }
  /// Random rooms, each in a file that `make` writes; the first is heard as well.
  void expect_random_rooms(std::uint32_t test, const std::string& name,
                           const std::function<std::string(const random_rooms::Room&, random_rooms::Draws&, std::uint32_t)>& make) const {
    for (std::uint32_t number = 0; number < kRooms; ++number) {
      random_rooms::Draws draws(test, number);
      const random_rooms::Room room = random_rooms::room(draws);
      const std::string mesh = write(fmt::format("{}_{}", number, name), make(room, draws, number));
      SCOPED_TRACE(mesh);
      expect_room(mesh, room);
      if (number == 0) expect_response(mesh, room);
    }
  }
};

}  // namespace earshot
