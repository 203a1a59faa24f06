// SPDX-License-Identifier: Apache-2.0
// A panel in the air as `earshot rir` hears it, from a scene file, against boundary elements.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "sim/base/text/json.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

constexpr std::size_t kOctaves = 6;

/// A rigid plate of 0.6 x 0.45 m about the origin of the plane z = 0, source at (-0.9, 0.4, 2.6): ten drawn listeners, and levels of the
/// scattered energy in the octaves of 63 Hz to 2 kHz, re 1 in Green units.  From tests/validation/rigid_plates.py (directions()).
struct Direction {
  std::array<double, 3> listener;
  std::array<double, kOctaves> level_db;
};
constexpr std::array<Direction, 10> kDirections = {{
    {{-0.54, -2.84, 1.43}, {-89.60, -77.54, -64.54, -60.27, -68.51, -69.80}},
    {{1.04, 0.26, 3.28}, {-83.54, -71.17, -57.04, -48.43, -44.83, -44.55}},
    {{-2.71, 1.11, 2.35}, {-88.05, -76.23, -64.23, -61.62, -65.36, -79.12}},
    {{2.70, 1.34, 1.16}, {-91.43, -79.37, -66.46, -59.66, -65.65, -71.55}},
    {{-1.90, 1.40, 2.72}, {-86.01, -74.02, -61.34, -58.57, -67.99, -76.00}},
    {{-2.28, 1.52, 1.81}, {-87.94, -76.17, -64.25, -61.97, -67.93, -75.40}},
    {{-1.35, -0.19, 2.48}, {-82.49, -70.46, -57.38, -54.32, -57.63, -58.04}},
    {{0.81, 2.21, 2.51}, {-85.84, -73.64, -60.13, -53.93, -57.08, -59.26}},
    {{-1.89, -0.48, 1.87}, {-84.13, -72.35, -60.15, -57.76, -57.75, -60.36}},
    {{-0.62, 2.97, 1.82}, {-89.17, -77.16, -64.38, -61.02, -72.74, -72.12}},
}};

class PanelReflectionCli : public Cli {
 protected:
  void write_plate(double absorption) const {
    const double x = 0.3, y = 0.225;
    write("plate.obj", fmt::format("usemtl plate\nv {0} {1} 0\nv {2} {1} 0\nv {2} {3} 0\nv {0} {3} 0\nf 1 2 3\nf 1 3 4\n", -x, -y, x, y));
    write("plate.json",
          fmt::format(R"({{"materials": [{{"name": "plate", "labels": ["default"], "scattering": [500, 0], "absorption": [500, {}]}}]}})",
                      absorption));
    write("scene.yaml", "mesh: plate.obj\nmaterials: plate.json\n");
  }
  /// Energy of all but the direct sound by octave, Green units.
  [[nodiscard]] std::array<double, kOctaves> beside_direct(const std::array<double, 3>& listener, const std::string& settings) const {
    const CliOutcome outcome = earshot(
        fmt::format("rir {} --source=-0.9,0.4,2.6 --listener={},{},{} --channels mono --out {} --metrics {} --set direct=off late=off "
                    "air_absorption=off low_octave=true rir_length_s=0.25 {}",
                    file("scene.yaml"), listener[0], listener[1], listener[2], file("r.wav"), file("r.json"), settings));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    const nlohmann::json metrics = parse_json(read("r.json"));
    std::array<double, kOctaves> energy{};
    EXPECT_NEAR(metrics["bands_hz"][0].get<double>(), 63.1, 0.5);
    for (std::size_t octave = 0; octave < kOctaves; ++octave)
      if (const nlohmann::json& g_db = metrics["energy"]["g_db"][octave]; g_db.is_number())
        energy[octave] = std::pow(10, 0.1 * g_db.get<double>()) / std::pow(4 * std::numbers::pi * 10, 2);
    return energy;
  }
};

// Octaves from 125 Hz; at 63 Hz the direct sound's waves at the rims, which stay without it, are above what is reflected.  All directions
// within 3 dB, root mean square, a factor of 2; those within 15 dB of the direction of the image within 2 dB.  The model is a product of
// two strips, which have 0.8 dB: beside a plate in both directions at once little is reflected, and single octaves are up to 8 dB low.
TEST_F(PanelReflectionCli, APlateReflectsToAllDirectionsAsBoundaryElements) {
  write_plate(0);
  for (const char* settings : {"", "diffraction=on"}) {
    double squares = 0, count = 0, loud_squares = 0, loud = 0;
    for (const Direction& direction : kDirections) {
      const std::array<double, kOctaves> energy = beside_direct(direction.listener, settings);
      std::string line;
      for (std::size_t octave = 1; octave < kOctaves; ++octave) {
        const double db = 10 * std::log10(std::max(energy[octave], 1e-14)) - direction.level_db[octave];
        squares += db * db, ++count;
        if (direction.level_db[octave] > kDirections[1].level_db[octave] - 15) loud_squares += db * db, ++loud;
        line += fmt::format(" {:5.2f}", db);
      }
      fmt::print("{}\n", line);
    }
    fmt::print("root mean square {:.2f} dB, {:.2f} dB of {} loud ones\n", std::sqrt(squares / count), std::sqrt(loud_squares / loud), loud);
    EXPECT_LT(std::sqrt(squares / count), 3.0) << settings;
    EXPECT_GT(loud, 20);
    EXPECT_LT(std::sqrt(loud_squares / loud), 2.0) << settings;
  }
}

}  // namespace
}  // namespace earshot
