// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "sim/base/text/json.h"
#include "tests/support/programs/cli.h"

namespace earshot {

/// A place at least `margin_m` from the walls of a box with a corner at the origin.
inline glm::dvec3 place_in_box(std::uint32_t stream, std::uint32_t index, glm::dvec3 size_m, double margin_m = 0.6) {
  const auto draw = RandomStream(stream, Purpose::test, 41).uniform4(index);
  return margin_m + (size_m - 2 * margin_m) * glm::dvec3(draw[0], draw[1], draw[2]);
}

/// Rooms "measured" by `earshot rir`: responses at drawn places of a box, and the places file that says where.
class MeasuredRoomFiles : public Cli {
 protected:
  /// Writes folder/rN.wav and folder/places.yaml; `heads` is what stands before the responses of the places file.
  void measure_box(const std::string& folder, const std::string& scene, glm::dvec3 size_m, int count, std::uint32_t stream,
                   const std::string& heads = "", const std::string& options = "") const {
    std::filesystem::create_directories(file(folder));
    std::string places = heads + "responses:\n";
    for (int i = 0; i < count; ++i) {
      const auto index = static_cast<std::uint32_t>(2 * i);
      const glm::dvec3 source = place_in_box(stream, index, size_m), listener = place_in_box(stream, index + 1, size_m);
      const std::string name = fmt::format("r{}.wav", i), from = text(source), to = text(listener);
      const CliOutcome outcome =
          earshot("rir " + scene + " --channels mono --preset balanced --set rir_length_s=1 --seed " + std::to_string(900 + i) +
                  " --source " + from + " --listener " + to + " " + options + " --out " + file(folder + "/" + name));
      ASSERT_EQ(outcome.exit_code, 0) << outcome.errors;
      places += fmt::format("  - {{file: {}, source: [{}], listener: [{}]}}\n", name, from, to);
    }
    write(folder + "/places.yaml", places);
  }
  [[nodiscard]] static std::string text(glm::dvec3 p) { return fmt::format("{:.4f},{:.4f},{:.4f}", p.x, p.y, p.z); }
  [[nodiscard]] nlohmann::json report_of(const std::string& arguments) const {
    const CliOutcome outcome = earshot(arguments + " --json " + file("report.json"));
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.errors;
    return outcome.exit_code == 0 ? parse_json(read("report.json")) : nlohmann::json();
  }
};

}  // namespace earshot
