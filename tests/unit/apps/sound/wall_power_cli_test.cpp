// SPDX-License-Identifier: Apache-2.0
// Sources near walls as `earshot rir` hears them: the level of late sound rises by Waterhouse's factor, in the metrics and in the samples.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "sim/base/random.h"
#include "tests/support/acoustics/edge_power.h"
#include "tests/support/draws.h"
#include "tests/support/files/drawn_room.h"
#include "tests/support/programs/rir_cli.h"

namespace earshot {
namespace {

class WallPowerCli : public RirCli {};

/// Mean over an octave of the closed form near up to three walls at right angles that reflect the pressure r; distances beyond 9 m count
/// as none.
double octave_factor(double centre_hz, const std::array<double, 3>& h, double r) {
  const double c = 2 * r / (1 + r * r);
  double sum = 0;
  constexpr int parts = 400;
  for (int i = 0; i < parts; ++i) {
    const double k =
        2 * std::numbers::pi / 343.2 * centre_hz * (std::pow(10, -0.15) + (i + 0.5) / parts * (std::pow(10, 0.15) - std::pow(10, -0.15)));
    for (int walls = 0; walls < 8; ++walls) {
      double d2 = 0, factor = 1;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if ((walls >> axis & 1) == 0) continue;
        factor *= h[axis] < 9 ? c : 0;
        d2 += 4 * h[axis] * h[axis];
      }
      const double x = k * std::sqrt(d2);
      sum += factor * (x > 1e-6 ? std::sin(x) / x : 1) / parts;
    }
  }
  return sum;
}

// 0.1 dB: the same rays with the factor and without; bands that it changes by less are left alone.  In the samples both have noise of their
// own, 1 to 3 dB for an octave of 0.3 s: their mean, of 30 values, within three standard errors of about 0.4 dB.
TEST_F(WallPowerCli, LateSoundRisesNearWallsEdgesAndCorners) {
  double sum_db = 0, squares = 0, count = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    const RandomStream random(38, Purpose::test, number);
    std::array<double, 3> h{7, 6.5, 6};
    for (std::size_t axis = 0; axis <= number % 3; ++axis)
      h[axis] = number == 2 ? 0.03 : 0.02 + 0.6 * static_cast<double>(random.uniform(static_cast<std::uint32_t>(axis)));
    const double absorption = 0.05 + 0.3 * static_cast<double>(random.uniform(7));
    const std::string arguments = fmt::format(
        "shoebox:14x13x12@{:.3f} --source {} --listener 7.3,6.2,5.8 --set direct=off early=off field=off "
        "rays=1024 rir_length_s=0.3 scattering=0",
        absorption, point_text({h[0], h[1], h[2]}));
    const nlohmann::json with = metrics(arguments), without = metrics(arguments + " wall_power=off");
    for (auto& distance : h) distance = distance > 5 ? 100 : distance;
    for (std::size_t band = 0; band < 3; ++band) {
      const double hz = with["bands_hz"][band], expected_db = 10 * std::log10(octave_factor(hz, h, std::sqrt(1 - absorption)));
      const auto rise = [&](const char* from) {
        return with[from]["g_db"][band].get<double>() - without[from]["g_db"][band].get<double>();
      };
      EXPECT_NEAR(rise("energy"), expected_db, 0.1) << number << ", " << hz;
      const double off_db = rise("rir") - expected_db;
      sum_db += off_db, squares += off_db * off_db, ++count;
    }
  }
  const double standard_error_db = std::sqrt(squares) / count;
  EXPECT_LT(standard_error_db, 0.6);
  EXPECT_LT(std::abs(sum_db / count), 3 * standard_error_db);
}

// A source near the free edge of a rigid sheet in a hall: the sheet is half a wall there, and none on the edge.  0.3 dB: that of the closed
// form (WallPowerPlates), and 0.1 dB of bands that are left alone.  As a wall without end it would have up to 3 dB more.
TEST_F(WallPowerCli, SheetsEndAtTheirEdges) {
  write("hall.obj", fmt::format("{}v 7 3 3\nv 7 3 9\nv 7 9 9\nv 7 9 3\nusemtl sheet\nf 9 10 11 12\n", [] {
          std::string box;
          for (int corner = 0; corner < 8; ++corner)
            box += fmt::format("v {} {} {}\n", corner & 1 ? 20 : 0, corner & 2 ? 16 : 0, corner & 4 ? 18 : 0);
          return box + "usemtl hall\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
        }()));
  write("walls.json",
        R"({"materials": [{"name": "hall", "labels": ["hall"], "absorption": [500, 0.2], "scattering": [500, 0]},
            {"name": "sheet", "labels": ["sheet", "default"], "absorption": [500, 0], "scattering": [500, 0]}]})");
  write("scene.yaml", "mesh: hall.obj\nmaterials: walls.json\n");
  double saved_db = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    Draws draw(3802, number);
    const double r = std::pow(10.0, draw.within(-1.3, 0.0)), around = draw.within(0.02, 0.48) * std::numbers::pi;
    const std::string arguments =
        fmt::format("{} --source {:.4f},{:.4f},6 --listener 14,7.5,6 --set direct=off early=off field=off rays=64 rir_length_s=0.1 ",
                    file("scene.yaml"), 7 + r * std::sin(around), 9 - r * std::cos(around));
    const nlohmann::json with = metrics(arguments), without = metrics(arguments + "wall_power=off");
    const double hz = with["bands_hz"][0], speed = 343.2;
    const double wanted_db =
        10 * std::log10(edge_power(hz * std::pow(10, -0.15), hz * std::pow(10, 0.15), speed, 2 * std::numbers::pi, r, around));
    EXPECT_NEAR(with["energy"]["g_db"][0].get<double>() - without["energy"]["g_db"][0].get<double>(), wanted_db, 0.3)
        << r << " m " << around;
    const double x = 4 * std::numbers::pi * hz / speed * r * std::sin(around);
    saved_db = std::max(saved_db, 10 * std::log10(1 + std::sin(x) / x) - wanted_db);
  }
  EXPECT_GT(saved_db, 1.5) << "no place was near the edge";
}

}  // namespace
}  // namespace earshot
