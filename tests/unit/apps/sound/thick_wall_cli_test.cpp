// SPDX-License-Identifier: Apache-2.0
// A wall between two rooms, of any thickness: what `earshot rir` lets through it.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <glm/vec3.hpp>

#include "sim/base/random.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

/// Two rooms side by side in one shell, and the wall between them as a box whose windings point outward.
class ThickWallCli : public Cli {
 protected:
  static constexpr double kRoomM = 4;

  [[nodiscard]] static double draw(std::uint32_t number, std::uint32_t index) {
    return static_cast<double>(RandomStream(38, Purpose::test, number).uniform(index));
  }
  static void append_box(std::string& obj, int& corners, glm::dvec3 lower, glm::dvec3 upper, bool inward, const std::string& material) {
    constexpr std::array<std::array<int, 4>, 6> sides{{{1, 5, 7, 3}, {2, 4, 8, 6}, {1, 2, 6, 5}, {3, 7, 8, 4}, {1, 3, 4, 2}, {5, 6, 8, 7}}};
    for (int corner = 0; corner < 8; ++corner)
      obj += fmt::format("v {} {} {}\n", corner & 1 ? upper.x : lower.x, corner & 2 ? upper.y : lower.y, corner & 4 ? upper.z : lower.z);
    obj += "usemtl " + material + "\n";
    for (const auto& side : sides) {
      obj += "f";
      for (int i = 0; i < 4; ++i) obj += fmt::format(" {}", corners + side[static_cast<std::size_t>(inward ? 3 - i : i)]);
      obj += "\n";
    }
    corners += 8;
  }
  /// Energy of the response through the wall: that of all, and that later than 30 ms.
  struct Energy {
    double all_db = 0, late_db = 0;
  };
  [[nodiscard]] Energy through(double thickness_m, double damping_db_per_m, double tau, const std::string& settings,
                               std::uint32_t number) const {
    std::string obj;
    int corners = 0;
    append_box(obj, corners, {0, 0, 0}, {2 * kRoomM + thickness_m, 3, 3}, true, "shell");
    append_box(obj, corners, {kRoomM, 0, 0}, {kRoomM + thickness_m, 3, 3}, false, "partition");
    write("walls.obj", obj);
    write("walls.json", fmt::format(R"({{"materials": [
      {{"name": "shell", "absorption": [125, 0.2, 4000, 0.2], "scattering": [125, 0.3, 4000, 0.3]}},
      {{"name": "partition", "absorption": [125, 0.2, 4000, 0.2], "scattering": [125, 0.3, 4000, 0.3],
        "transmission": [125, {0}, 4000, {0}], "damping": [125, {1}, 4000, {1}]}}]}})",
                                    tau, damping_db_per_m));
    write("walls.yaml", "mesh: walls.obj\nmaterials: walls.json\n");
    const double y = 1 + draw(number, 0), z = 0.5 + 2 * draw(number, 1);
    source_ = {0.5 + 2 * draw(number, 2), y, z};
    listener_ = {kRoomM + thickness_m + 1 + 2 * draw(number, 3), y, z};  // straight through
    const auto text = [](glm::dvec3 p) { return fmt::format("{},{},{}", p.x, p.y, p.z); };
    const CliOutcome outcome =
        earshot("rir " + file("walls.yaml") + " --source " + text(source_) + " --listener " + text(listener_) +
                " --channels mono --set rir_length_s=0.6 air_absorption=off " + settings + " --out " + file("x.wav"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    Energy energy;
    const std::vector<float> samples = read_wav("x.wav");
    for (std::size_t n = 0; n < samples.size(); ++n) {
      energy.all_db += static_cast<double>(samples[n]) * static_cast<double>(samples[n]);
      if (n > 480) energy.late_db += static_cast<double>(samples[n]) * static_cast<double>(samples[n]);
    }
    energy.all_db = 10 * std::log10(energy.all_db);
    energy.late_db = 10 * std::log10(energy.late_db);
    return energy;
  }
  mutable glm::dvec3 source_{0}, listener_{0};  ///< of the last response
};

// Straight through: tau once, and the damping of each metre, at any thickness.
TEST_F(ThickWallCli, TheStraightLineIsDampedAtEveryMetre) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const double thickness_m = 0.05 + 3 * draw(number, 10), damping = 2 + 8 * draw(number, 11), tau = 0.02 + 0.15 * draw(number, 12);
    const std::string direct = "transmission=on late=off early=off diffraction=off";
    const double damped_db = through(thickness_m, damping, tau, direct, number).all_db;
    // The same without a wall's loss: thin, tau 0.2, at the same distance.
    const double expected_db = -20 * std::log10(listener_.x - source_.x) + 10 * std::log10(tau) - damping * thickness_m;
    const double thin_db = through(0.05, 0, 0.2, direct, number).all_db;
    const double thin_expected_db = -20 * std::log10(listener_.x - source_.x) + 10 * std::log10(0.2);
    EXPECT_NEAR(damped_db - thin_db, expected_db - thin_expected_db, 0.05) << thickness_m << " m, " << damping << " dB/m, tau " << tau;
  }
}

// By the effect plan: walls a little thinner and thicker than where two faces without damping become two walls.
TEST_F(ThickWallCli, LateSoundDoesNotDependOnAThicknessLimit) {
  for (std::uint32_t number = 0; number < 6; ++number) {
    const double damping = 1.5 + 10 * draw(number, 20), tau = 0.05 + 0.1 * draw(number, 21);
    const std::string plan = "--preset balanced";
    const double thin_db = through(0.59, damping, tau, plan, number).late_db, thick_db = through(0.62, damping, tau, plan, number).late_db;
    EXPECT_NEAR(thick_db, thin_db, 1.0) << damping << " dB/m, tau " << tau;
  }
}

// Without damping a thick wall is two sheets, and the late sound passes both.
TEST_F(ThickWallCli, LateSoundPassesTwoSheetsAtAnyDistance) {
  for (std::uint32_t number = 0; number < 6; ++number) {
    const double thickness_m = 0.61 + 0.4 * draw(number, 30);
    const double late_db = through(thickness_m, 0, 0.1, "--preset balanced", number).late_db;
    const double far_db = through(1.1, 0, 0.1, "--preset balanced", number).late_db;
    EXPECT_NEAR(late_db, far_db, 2.0) << thickness_m;
    // Half of tau on either sheet is 6.02 dB less, 3.01 if one of them were passed; a decibel is what two responses scatter by.
    EXPECT_NEAR(late_db - through(thickness_m, 0, 0.05, "--preset balanced", number).late_db, 6.02, 1.0) << thickness_m;
  }
}

}  // namespace
}  // namespace earshot
