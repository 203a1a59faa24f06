// SPDX-License-Identifier: Apache-2.0
// A source with a radius behind an edge: what `earshot rir --source-radius` brings of its direct sound.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/random.h"
#include "tests/support/programs/cli.h"

namespace earshot {
namespace {

/// A screen 40 m wide with its upper edge at a height, between a source at z = 0 and a listener at z = distance_m.
class SphereSourceCli : public Cli {
 protected:
  /// Energy of the direct sound.  edge_y: of the screen, at z = screen_z.
  [[nodiscard]] double energy(double edge_y, double screen_z, double distance_m, double radius_m, const std::string& settings = "") const {
    write("screen.obj",
          fmt::format("v -20 {0} {1}\nv 20 {0} {1}\nv 20 -30 {1}\nv -20 -30 {1}\nusemtl screen\nf 1 2 3 4\n", edge_y, screen_z));
    write("screen.json", R"({"materials": [{"name": "screen", "absorption": [125, 0.3], "scattering": [125, 0.2]}]})");
    write("screen.yaml", "mesh: screen.obj\nmaterials: screen.json\n");
    const CliOutcome outcome =
        earshot(fmt::format("rir {} --source 0,0,0 --listener 0,0,{} --source-radius {} --channels mono --set rir_length_s=0.1 late=off "
                            "early=off diffraction=off "
                            "{} --out {}",
                            file("screen.yaml"), distance_m, radius_m, settings, file("x.wav")));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    double sum = 0;
    for (const float sample : read_wav("x.wav")) sum += double{sample} * double{sample};
    return sum;
  }
};

// The circular segment above the edge, within the error of 64 points over half planes (sphere_arrivals.h).
TEST_F(SphereSourceCli, DirectSoundFollowsTheVisibleSegment) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RandomStream random(38, Purpose::test, number);
    const double distance_m = 3 + 6 * double{random.uniform(0)}, radius_m = 0.2 + 0.8 * double{random.uniform(1)};
    const double part = 0.25 + 0.5 * double{random.uniform(2)};  // of the way from the source
    const double edge = -1 + 2 * double{random.uniform(3)};      // in radii, where it is on the disc
    const double screen_z = part * distance_m, edge_y = edge * radius_m * (1 - part);
    const double whole = energy(edge_y - 20, screen_z, distance_m, radius_m);
    ASSERT_GT(whole, 0);
    const double visible = 0.5 - (std::asin(edge) + edge * std::sqrt(1 - edge * edge)) / std::numbers::pi;
    EXPECT_NEAR(energy(edge_y, screen_z, distance_m, radius_m) / whole, visible, 0.05) << number << " edge at " << edge;
    // The centre alone: all or nothing.
    const double alone = energy(edge_y, screen_z, distance_m, radius_m, "direct_rays=0") / whole;
    EXPECT_NEAR(alone, edge < 0 ? 1 : 0, 1e-4);
  }
}

TEST_F(SphereSourceCli, RefusesMoreRaysThanItTakes) {
  write("screen.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  expect_bad_input("rir " + file("screen.obj") + " --source 0,0,1 --listener 0,0,2 --set direct_rays=5000 --out " + file("x.wav"),
                   "direct_rays is 5000");
}

}  // namespace
}  // namespace earshot
