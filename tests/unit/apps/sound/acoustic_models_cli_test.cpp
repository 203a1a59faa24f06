// SPDX-License-Identifier: Apache-2.0
// Choices of the acoustic model, through `earshot rir`: sources with a radius, lobes from scattering, late sound round edges.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "sim/base/random.h"
#include "sim/base/text/json.h"
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

class LobeCli : public Cli {
 protected:
  [[nodiscard]] std::vector<float> response(double scattering, const std::string& exponent) const {
    const CliOutcome outcome = earshot(fmt::format(
        "rir shoebox:5x4x3 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --channels mono --set late=on early=off rir_length_s=0.3 rays=256 "
        "source_rays=256 scattering={} specular_exponent={} --metrics {} --out {}",
        scattering, exponent, file("m.json"), file("x.wav")));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.errors;
    return read_wav("x.wav");
  }
};

// Parameters of the energy response: the noise of the samples differs with each setting.
TEST_F(LobeCli, EndsAreTheMirrorAndLambert) {
  const auto energy = [&](double scattering, const std::string& exponent) {
    (void)response(scattering, exponent);
    return parse_json(read("m.json")).at("energy").dump();
  };
  EXPECT_EQ(energy(1, "from_scattering"), energy(1, "0"));
  EXPECT_EQ(energy(0, "from_scattering"), energy(0, "0"));
  EXPECT_NE(energy(0.5, "from_scattering"), energy(0.5, "0"));
}

// The energy after 30 ms, by which scattering mixes directions in a room of even walls, is that of a mirror and Lambert within 1 dB.
TEST_F(LobeCli, BringsTheSameEnergy) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const double s = 0.15 + 0.85 * double{RandomStream(38, Purpose::test, number).uniform(0)};
    double energy[2] = {};
    for (int i = 0; i < 2; ++i) {
      const std::vector<float> samples = response(s, i == 0 ? "0" : "from_scattering");
      for (std::size_t n = 0; n < samples.size(); ++n) energy[i] += n > 480 ? double{samples[n]} * double{samples[n]} : 0;
    }
    EXPECT_NEAR(10 * std::log10(energy[1] / energy[0]), 0, 1) << s;
  }
}

TEST_F(LobeCli, RefusesAnExponentBelowOne) {
  expect_bad_input("rir shoebox:5x4x3 --source 1,1,1 --listener 2,1,2 --set specular_exponent=0.5 --out " + file("x.wav"),
                   "specular_exponent");
}

// --late-edges: nothing in a room without edges; in two rooms with a door a line for each band, and the same in the metrics file.
TEST_F(LobeCli, LateSoundRoundEdgesIsEstimatedOnRequest) {
  const std::string box = "rir shoebox:5x4x3 --source 1.2,1.1,1.5 --listener 3.8,1.6,2.3 --preset fast --late-edges --out " + file("x.wav");
  EXPECT_THAT(earshot(box).output, testing::HasSubstr("late sound round edges: 0.00 dB more, loss of lit sides not subtracted"));
  const CliOutcome house = earshot("rir house:7 --source 2,1.5,2 --listener 10,1.5,5 --preset fast --late-edges --metrics " +
                                   file("m.json") + " --out " + file("x.wav"));
  EXPECT_EQ(house.exit_code, 0) << house.errors;
  EXPECT_THAT(house.output, testing::HasSubstr("late sound round edges: "));
  EXPECT_THAT(read("m.json"), testing::HasSubstr("\"late_edges_db\": ["));
  EXPECT_THAT(earshot("rir house:7 --source 2,1.5,2 --listener 10,1.5,5 --preset fast --out " + file("x.wav")).output,
              testing::Not(testing::HasSubstr("late sound")));
}

TEST_F(LobeCli, LateEdgesWithoutEdgesOrLateSoundAreRefused) {
  for (const char* setting : {"diffraction=off", "late=off"})
    expect_bad_input(std::string("rir house:7 --source 2,1.5,2 --listener 10,1.5,5 --preset fast --late-edges --set ") + setting +
                         " --out " + file("x.wav"),
                     setting);
}

}  // namespace
}  // namespace earshot
