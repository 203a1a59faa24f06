// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/bidirectional_tracer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "sim/acoustics/metrics/late_errors.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/audio/head/directivity.h"
#include "tests/support/acoustics/bidirectional_field.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using rooms::bidirectional_config;
using rooms::bidirectional_field;
using rooms::BidirectionalField;
using rooms::expect_near;
using rooms::expect_same;
using rooms::Sample;

TEST(Bidirectional, O8_OneDiffuseBouncePerWall) {
  const double expected[6][3] = {{3.315472e-04, 16.4157, 1.46214e-04}, {3.393299e-04, 16.4386, 1.49468e-04},
                                 {3.373553e-04, 15.3039, 1.57369e-04}, {2.868505e-04, 16.2671, 1.27503e-04},
                                 {5.257685e-04, 13.2084, 2.72604e-04}, {4.373527e-04, 14.5576, 2.11955e-04}};
  AcousticConfig config = bidirectional_config(16384);
  config.max_bounces = 1;
  config.time_bin_s = 2e-4f;
  config.rir_length_s = 0.1f;
  for (int wall = 0; wall < 6; ++wall) {
    std::array<Material, 6> walls = rooms::uniform_walls(1, 1);
    walls[wall] = Material::uniform("diffuse", 0.f, 1.f);
    const BidirectionalField field =
        bidirectional_field(rooms::box(5, 4, 3, walls), config, rooms::shoe1_source(), rooms::shoe1_listener());
    const Sample energy = field.total();
    // Two strategies fraction one edge each; 4 sigma of 0.2 %.
    expect_near(energy, expected[wall][0], 4, 4e-3);
    expect_near(field.sum(0, [](double t) { return std::exp(-50 * t); }), expected[wall][2], 4, 4e-3);
    EXPECT_NEAR(1e3 * field.sum(0, [](double t) { return t; }).mean / energy.mean, expected[wall][1], 5e-3 * expected[wall][1]);
    EXPECT_EQ(field.stats.nonfinite_dropped, 0u);
  }
}

TEST(Bidirectional, O11_DirectToReverberantRatio) {
  AcousticConfig config = bidirectional_config(8192);
  const BidirectionalField field = bidirectional_field(rooms::shoe1(0.2, 1), config, rooms::shoe1_source(), rooms::shoe1_listener());
  // 0.01 dB is one standard error; without the 4 pi the value would be -22.615 dB.
  EXPECT_NEAR(10 * std::log10(8.277874e-4 / field.total().mean), -11.623, 0.04);
}

TEST(Bidirectional, O8_ASmallSourceSphereIsAPoint) {
  const auto room = rooms::shoe1(0.2, 1);
  AcousticConfig config = bidirectional_config(8192);
  config.rir_length_s = 0.3f;
  SoundSource source = rooms::shoe1_source();
  const double point = bidirectional_field(room, config, source, rooms::shoe1_listener()).total().mean;
  AcousticConfig rooted_config = config;
  rooted_config.source_rays = 0;
  const AcousticScene rooted(room, rooted_config);
  EnergyHistogram histogram = make_histogram(rooted);
  trace_late(rooted, EarlyCandidates(rooted, source), rooms::shoe1_listener(), histogram);
  const double rooted_point = rooms::total_energy(histogram);

  source.radius_m = 1e-3f;  // same seed, same paths: the difference is that of the radius alone
  EXPECT_NEAR(bidirectional_field(room, config, source, rooms::shoe1_listener()).total().mean, point, 1e-3 * point);
  trace_late(rooted, EarlyCandidates(rooted, source), rooms::shoe1_listener(), histogram);
  EXPECT_NEAR(rooms::total_energy(histogram), rooted_point, 1e-3 * rooted_point);
  source.radius_m = 0.3f;
  const double wide = bidirectional_field(room, config, source, rooms::shoe1_listener()).total().mean;
  EXPECT_NEAR(wide, point, 0.05 * point);  // the field hardly varies over 30 cm
  EXPECT_NE(wide, point);
}

TEST(Bidirectional, H20_ASourceNearAWallKeepsTheTrend) {
  // Level against height above the floor is smooth; 1 mm must continue what 5 and 10 cm say.
  const auto room = rooms::shoe1(0.2, 1);
  AcousticConfig config = bidirectional_config(8192);
  const auto at_height = [&](double height_m) {
    return bidirectional_field(room, config, rooms::point(1.2, 1.5, height_m), rooms::shoe1_listener()).total();
  };
  const Sample near = at_height(0.001), at_5_cm = at_height(0.05), at_10_cm = at_height(0.10);
  const double extrapolated = at_5_cm.mean - 0.98 * (at_10_cm.mean - at_5_cm.mean);
  const double error = std::hypot(near.standard_error, 1.98 * at_5_cm.standard_error, 0.98 * at_10_cm.standard_error);
  EXPECT_NEAR(near.mean, extrapolated, 0.01 * extrapolated + 3 * error) << near.mean << " " << at_5_cm.mean << " " << at_10_cm.mean;
  EXPECT_LT(near.standard_error, 0.005 * near.mean);
}

TEST(Bidirectional, BandsThatDecayApartShareRaysWithoutBias) {
  // Roulette and splitting choose by all bands together (population_control.h).  Independent value: the room in one band at a time.
  Material material = Material::uniform("m", 0.3f, 1.f);
  material.absorption = {{88.f, 353.55f, 1414.2f, 5657.f}, {0.1f, 0.2f, 0.4f, 0.6f}};
  std::array<Material, 6> walls;
  walls.fill(material);
  const auto room = rooms::box(5, 4, 3, walls);
  AcousticConfig config = bidirectional_config(4096);
  config.bands = 4;
  config.rir_length_s = 0.5f;
  const BidirectionalField shared = bidirectional_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
  for (int band = 0; band < 4; ++band) {
    const double absorption = 1 - AcousticScene(room, config).reflectance(0)[band];
    AcousticConfig seeded_config = config;
    seeded_config.bands = 1;
    seeded_config.seed = 1;
    const BidirectionalField alone =
        bidirectional_field(rooms::shoe1(absorption, 1), seeded_config, rooms::shoe1_source(), rooms::shoe1_listener());
    const auto late = [](double t) { return t > 0.1 ? 1.0 : 0.0; };
    expect_same(shared.total(band), alone.total(), 4, 0.01);
    if (band < 2) expect_same(shared.sum(band, late), alone.sum(0, late), 4, 0.05);
  }
}

TEST(Bidirectional, DegenerateInputStaysFinite) {
  AcousticConfig config = bidirectional_config(64);
  config.late = Switch::on;  // the plan would not trace at all where nothing comes back
  const auto finite = [](const BidirectionalField& field) {
    return std::all_of(field.histogram.values().begin(), field.histogram.values().end(), [](float v) { return std::isfinite(v); });
  };
  EXPECT_EQ(bidirectional_field(rooms::empty(), config, glm::vec3(1, 0, 0), {0, 0, 0}).total().mean, 0);
  EXPECT_EQ(bidirectional_field(rooms::shoe1(1, 1), config, rooms::shoe1_source(), rooms::shoe1_listener()).total().mean, 0);
  EXPECT_TRUE(finite(bidirectional_field(rooms::shoe1(1e-7, 0), config, rooms::shoe1_source(), rooms::shoe1_source())));
  EXPECT_TRUE(finite(bidirectional_field(rooms::shoe1(0.1, 1), config, rooms::point(0, 0, 0), rooms::point(5, 4, 3))));
  for (const int rays : {0, 1, 3}) {
    config.rays = rays;
    for (const int source_rays : {0, 1, 5}) {
      config.source_rays = source_rays;
      EXPECT_TRUE(finite(bidirectional_field(rooms::shoe1(0.2, 0.5), config, rooms::shoe1_source(), rooms::shoe1_listener())));
    }
  }
}

}  // namespace
}  // namespace earshot
