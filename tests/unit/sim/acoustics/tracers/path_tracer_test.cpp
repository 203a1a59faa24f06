// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/path_tracer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <vector>

#include "sim/acoustics/response/energy_response.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using rooms::laplace_sum;
using rooms::late_field;
using rooms::over_seeds;
using rooms::plain_config;
using rooms::Sample;
using rooms::total_energy;

TEST(PathTracer, OneDiffuseBouncePerWallO8) {
  // One Lambert wall at a time, the others absorb everything.  Green p2, mean arrival in ms, sum e exp(-50 t); alpha = 0.
  const double expected[6][3] = {{3.315472e-04, 16.4157, 1.46214e-04}, {3.393299e-04, 16.4386, 1.49468e-04},
                                 {3.373553e-04, 15.3039, 1.57369e-04}, {2.868505e-04, 16.2671, 1.27503e-04},
                                 {5.257685e-04, 13.2084, 2.72604e-04}, {4.373527e-04, 14.5576, 2.11955e-04}};
  AcousticConfig config = plain_config();
  config.rays = 32768;
  config.max_bounces = 1;
  config.time_bin_s = 2e-4f;  // fine bins: the split keeps the mean time, and exp(-50 t) deviates from a line by 1e-5 over a bin
  config.rir_length_s = 0.1f;
  for (int wall = 0; wall < 6; ++wall) {
    std::array<Material, 6> walls = rooms::uniform_walls(1, 1);
    walls[wall] = Material::uniform("diffuse", 0.f, 1.f);
    TraceStats stats;
    const EnergyHistogram h = late_field(rooms::box(5, 4, 3, walls), config, rooms::shoe1_source(), rooms::shoe1_listener(), &stats);
    double energy = total_energy(h), moment = 0;
    for (int i = 0; i < h.num_bins(); ++i) moment += h.energy(i, 0) * (i + 0.5) * h.bin_s();
    // The first direction is of low discrepancy: over 30 seeds the spread is 0.1 %; a wrong pi or cosine is tens of per cent.
    EXPECT_NEAR(energy, expected[wall][0], 5e-3 * expected[wall][0]) << wall;
    EXPECT_NEAR(1e3 * moment / energy, expected[wall][1], 5e-3 * expected[wall][1]) << wall;
    EXPECT_NEAR(laplace_sum(h, 50), expected[wall][2], 7e-3 * expected[wall][2]) << wall;
    EXPECT_EQ(stats.nonfinite_dropped, 0u);
  }
}

TEST(PathTracer, OneBounceScalesWithScatteringAndReflectance) {
  AcousticConfig config = plain_config();
  config.rays = 16384;
  config.max_bounces = 1;
  config.source_radius_m = 1e-3f;  // the mirror fraction of one bounce would need luck to be caught: it is left out here
  const EnergyHistogram h = late_field(rooms::shoe1(0.2, 0.3), config, rooms::shoe1_source(), rooms::shoe1_listener());
  EXPECT_NEAR(total_energy(h), 0.8 * 0.3 * 0.002258204, 0.01 * 0.8 * 0.3 * 0.002258204);
}

TEST(PathTracer, NormalisationChainO11O13) {
  AcousticConfig config = plain_config();
  config.rays = 4096;
  config.rir_length_s = 0.6f;
  const double direct = 8.277874e-4;  // (1 / (4 pi 2.765863 m))^2
  const Sample late = over_seeds(4, config, [&](const AcousticConfig& c) {
    return total_energy(late_field(rooms::shoe1(0.2, 1), c, rooms::shoe1_source(), rooms::shoe1_listener()));
  });
  // 0.02 dB is one standard error here; without the 4 pi the value would be -22.615 dB.
  EXPECT_NEAR(10 * std::log10(direct / late.mean), -11.623, 0.1);
  EXPECT_NEAR(10 * std::log10((direct + late.mean) / 6.332574e-5), 23.075, 0.1);
}

TEST(PathTracer, DiffuseFieldLevelO12) {
  // alpha <= 0.1, proportionate, Lambert: the room constant holds within 10 %.
  AcousticConfig config = plain_config();
  config.rays = 512;
  config.rir_length_s = 1.2f;
  const double level = total_energy(late_field(rooms::shoe1(0.1, 1), config, rooms::shoe1_source(), rooms::shoe1_listener()));
  EXPECT_NEAR(level, 0.0304765, 0.1 * 0.0304765);
}

TEST(PathTracer, LosslessRoomIsFlatO18H21) {
  AcousticConfig config = plain_config();
  config.rir_length_s = 0.4f;
  struct Case {
    double scattering;
    bool diffuse_last_segment;
    int rays;
    double tolerance;  // four standard errors over seeds
  };
  for (const Case& c : {Case{1, true, 1024, 0.04}, Case{0.4, true, 1024, 0.04}, Case{0.4, false, 4096, 0.1}}) {
    config.diffuse_last_segment = c.diffuse_last_segment;
    config.source_radius_m = 0.6f;  // a large volume: the field is uniform, so its mean is that of a point
    config.rays = c.rays;
    TraceStats stats;
    const EnergyHistogram h = late_field(rooms::shoe1(0, c.scattering), config, rooms::shoe1_source(), rooms::shoe1_listener(), &stats);
    double windows[3] = {};
    for (int i = 25; i < 100; ++i) windows[(i - 25) / 25] += h.energy(i, 0);
    for (const double energy : windows) {
      // c / (4 pi V) = 0.454921 per second; without the 4 pi it would be 5.7.
      EXPECT_NEAR(energy / 0.1, 0.454921, c.tolerance * 0.454921) << c.scattering << c.diffuse_last_segment;
    }
    EXPECT_EQ(stats.ray_escapes, 0u);
    EXPECT_EQ(stats.ray_efficiency(), 1.0);
  }
}

// A floor between source and listener, and across it a sheet that reflects nothing and passes a tenth.  Every path over the floor crosses
// the sheet once, before the floor or behind it, so the floor's diffuse energy (O-7, HS1) arrives with a tenth: also the mirror fraction,
// since image paths pass no walls and the fast mode takes the last segment as diffuse.
TEST(PathTracer, LastSegmentsThroughWallsKeepTheSpecularPart) {
  TriangleMesh mesh;
  const double far = 3000;
  rooms::append_quad(mesh, {rooms::point(-far, -far, 0), rooms::point(far, -far, 0), rooms::point(far, far, 0), rooms::point(-far, far, 0)},
                     0);
  rooms::append_quad(mesh, {rooms::point(5, -far, 0), rooms::point(5, far, 0), rooms::point(5, far, far), rooms::point(5, -far, far)}, 1);
  const auto room = rooms::scene_of(std::move(mesh), {Material::uniform("floor", 0.f, 0.1f), Material::uniform("sheet", 1.f, 0.f, 0.1f)});
  AcousticConfig config = plain_config();
  config.rays = 32768;
  config.early = Switch::automatic;
  config.transmission = Switch::on;
  config.diffuse_last_segment = true;
  config.max_bounces = 4;
  const rooms::Sample energy = rooms::over_seeds(6, config, [&](const AcousticConfig& c) {
    double sum = 0;
    for (const double value : late_field(room, c, rooms::point(0, 0, 1.5), rooms::point(10, 0, 1.5)).band_energy(0)) sum += value;
    return sum;
  });
  EXPECT_LT(energy.standard_error, 0.02 * energy.mean);
  EXPECT_NEAR(energy.mean, 0.1 * 3.33881e-05, 0.02 * 3.33881e-06 + 4 * energy.standard_error);
}

// What the walls of a closed room let out is lost to the room as what they absorb is: no bounce gives it back.  Rays are the same, so that
// the two differ by the draws at walls alone; 16,384 of them leave 2 %.
TEST(PathTracer, WhatWallsLetOutIsLostToTheRoom) {
  for (const double scattering : {1.0, 0.3}) {
    std::array<Material, 6> walls;
    walls.fill(Material::uniform("wall", 0.6f, static_cast<float>(scattering), 0.5f));
    const auto room = rooms::box(5, 4, 3, walls);
    AcousticConfig config = plain_config();
    config.rays = 16384;
    config.diffuse_last_segment = true;
    const auto energy = [&](Switch transmission) {
      config.transmission = transmission;
      double sum = 0;
      for (const double value : late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener()).band_energy(0)) sum += value;
      return sum;
    };
    EXPECT_NEAR(energy(Switch::on) / energy(Switch::off), 1, 0.06) << scattering;
  }
}

TEST(PathTracer, HalfSpaceHasNoTailO7) {
  AcousticConfig config = plain_config();
  config.rays = 4096;
  config.early = Switch::automatic;
  config.max_bounces = 1;
  config.diffuse_last_segment = true;  // exact last segments would follow the mirror once more
  TraceStats stats;
  const auto source = rooms::point(0, 0, 1.5), listener = rooms::point(10, 0, 1.5);
  const EnergyHistogram mirror = late_field(rooms::half_space(0, 0), config, source, listener, &stats);
  for (const float value : mirror.values()) EXPECT_EQ(value, 0.f);
  // Half of the sphere of directions, up to the discrepancy of the sequence.  With more bounces the segments that leave the
  // ground count as well, and the fraction is a third.
  EXPECT_NEAR(stats.ray_efficiency(), 0.5, 2e-3);

  struct Case {
    double source_height_m, listener_height_m, distance_m, energy;
  };
  config.max_bounces = 50;
  config.diffuse_last_segment = false;
  config.rays = 65536;
  config.rir_length_s = 2.f;
  for (const Case& c : {Case{1.5, 1.5, 10, 3.33881e-05}, Case{2.0, 1.2, 25, 2.53136e-06}, Case{1.5, 1.5, 3, 4.97534e-04}}) {
    const EnergyHistogram diffuse = late_field(rooms::half_space(0.1, 0.5), config, rooms::point(0, 0, c.source_height_m),
                                               rooms::point(c.distance_m, 0, c.listener_height_m), &stats);
    // Distant patches of ground matter little to energy but much to variance: 1.5 % over seeds.
    EXPECT_NEAR(total_energy(diffuse), 0.5 * 0.9 * c.energy, 0.05 * 0.5 * 0.9 * c.energy);
    EXPECT_EQ(diffuse.energy(diffuse.num_bins() - 1, 0) > 1e-3 * c.energy, false);
  }
}

TEST(PathTracer, DiffuseLastLegMovesTheLevelLittle) {
  const auto room = rooms::shoe1(0.2, 0.1);
  AcousticConfig config = plain_config();
  config.early = Switch::automatic;
  config.rays = 8192;
  const auto level = [&](bool diffuse) {
    config.diffuse_last_segment = diffuse;
    return 10 * std::log10(total_energy(late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener())));
  };
  EXPECT_NEAR(level(true), level(false), 0.6);
}

TEST(PathTracer, ScalingByPowersOfTwoKeepsBitsO19) {
  // Shifted away from the origin: the offset that leaves a surface is relative above 1/32 m and absolute below.
  const auto shifted = [](double scale) {
    TriangleMesh mesh;
    const auto k = static_cast<float>(scale);
    append_box(mesh, k * glm::vec3(1, 1, 1), k * glm::vec3(6, 4, 5), 0, 0);
    return rooms::scene_of(mesh, {Material::uniform("wall", 0.2f, 0.4f)});
  };
  const auto response_at = [&](double scale) {
    AcousticConfig config = plain_config();
    const auto k = static_cast<float>(scale);
    config.early = Switch::automatic;
    config.rays = 200;
    config.time_bin_s = 0.004f * k;
    config.rir_length_s = 0.4f * k;
    config.source_radius_m = 0.25f * k;
    const AcousticScene scene(shifted(scale), config);
    const EarlyCandidates candidates(scene, k * glm::vec3(2.2f, 2.1f, 2.5f));
    EnergyResponse response;
    compute_energy_response(scene, candidates, k * glm::vec3(4.8f, 2.6f, 3.3f), response);
    return response;
  };
  const EnergyResponse base = response_at(1);
  for (const double scale : {0.0625, 0.25, 2.0, 16.0}) {
    const EnergyResponse scaled = response_at(scale);
    const auto k = static_cast<float>(scale);
    ASSERT_EQ(scaled.arrivals.size(), base.arrivals.size());
    for (std::size_t i = 0; i < base.arrivals.size(); ++i) {
      EXPECT_EQ(scaled.arrivals[i].distance_m, k * base.arrivals[i].distance_m);
      EXPECT_EQ(scaled.arrivals[i].amplitude[0], base.arrivals[i].amplitude[0] / k);
    }
    ASSERT_EQ(scaled.late.num_bins(), base.late.num_bins());
    EXPECT_EQ(scaled.stats.ray_hits, base.stats.ray_hits);
    for (int i = 0; i < base.late.num_bins(); ++i)
      EXPECT_EQ(scaled.late.energy(i, 0), base.late.energy(i, 0) / (k * k)) << scale << " bin " << i;
  }
}

TEST(PathTracer, SamePoseSameBitsH51) {
  const AcousticScene scene(rooms::shoe1(0.2, 0.3), AcousticConfig{});
  const EarlyCandidates candidates(scene, rooms::shoe1_source());
  EnergyResponse first, again;
  compute_energy_response(scene, candidates, rooms::shoe1_listener(), first);
  for (int i = 0; i < 20; ++i) {
    compute_energy_response(scene, candidates, rooms::point(1 + 0.1 * i, 1, 1), again);  // other poses in between
    compute_energy_response(scene, candidates, rooms::shoe1_listener(), again);
    ASSERT_TRUE(std::equal(first.late.values().begin(), first.late.values().end(), again.late.values().begin()));
    ASSERT_EQ(first.arrivals.size(), again.arrivals.size());
  }
}

TEST(PathTracer, SeedsDifferH50) {
  const auto room = rooms::shoe1(0.2, 1);
  AcousticConfig config = plain_config();
  const auto energy = [&](std::uint64_t seed) {
    config.seed = seed;
    return total_energy(late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener()));
  };
  EXPECT_NE(energy(0), energy(1));
  EXPECT_NE(energy(0), energy(std::numeric_limits<std::uint64_t>::max()));
  EXPECT_EQ(energy(7), energy(7));
}

TEST(PathTracer, EverythingAbsorbedH22) {
  TraceStats stats;
  AcousticConfig config = plain_config();
  config.late = Switch::on;  // the plan would not trace at all
  const EnergyHistogram h = late_field(rooms::shoe1(1, 1), config, rooms::shoe1_source(), rooms::shoe1_listener(), &stats);
  for (const float value : h.values()) EXPECT_EQ(value, 0.f);
  EXPECT_EQ(stats.ray_hits, 64u);  // one each
  EXPECT_EQ(stats.shadow_rays, 0u);
}

TEST(PathTracer, NearlyNothingAndNearlyAllAbsorbedH23) {
  for (const double absorption : {1e-7, 1 - 1e-7}) {
    TraceStats stats;
    const EnergyHistogram h =
        late_field(rooms::shoe1(absorption, 0.5), plain_config(), rooms::shoe1_source(), rooms::shoe1_listener(), &stats);
    for (const float value : h.values()) EXPECT_TRUE(std::isfinite(value));
    EXPECT_EQ(stats.nonfinite_dropped, 0u);
  }
}

TEST(PathTracer, EmptySceneH25) {
  TraceStats stats;
  AcousticConfig config = plain_config();
  config.late = Switch::on;  // the plan would not trace at all
  const EnergyHistogram h = late_field(rooms::empty(), config, {1, 0, 0}, {0, 0, 0}, &stats);
  for (const float value : h.values()) EXPECT_EQ(value, 0.f);
  EXPECT_EQ(stats.ray_escapes, 64u);
  EXPECT_EQ(stats.ray_efficiency(), 0.0);
}

TEST(PathTracer, ZeroAndOneRayH48) {
  AcousticConfig config = plain_config();
  config.rays = 0;
  TraceStats stats;
  EXPECT_EQ(total_energy(late_field(rooms::shoe1(0.2, 1), config, rooms::shoe1_source(), rooms::shoe1_listener(), &stats)), 0.0);
  EXPECT_EQ(stats.rays, 0u);
  config.rays = 1;
  const double one = total_energy(late_field(rooms::shoe1(0.2, 1), config, rooms::shoe1_source(), rooms::shoe1_listener()));
  EXPECT_TRUE(std::isfinite(one));
  EXPECT_GT(one, 0.0);
}

TEST(PathTracer, ShorterThanTheDirectDelayH32) {
  AcousticConfig config;
  config.rir_length_s = 0.004f;  // 1.4 m; the source is 2.8 m away
  const AcousticScene scene(rooms::shoe1(0.2, 0.5), config);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, rooms::shoe1_source()), rooms::shoe1_listener(), response);
  EXPECT_TRUE(response.arrivals.empty());
  EXPECT_EQ(response.late.num_bins(), 1);
  for (const float value : response.late.values()) EXPECT_EQ(value, 0.f);
}

TEST(PathTracer, HugeRoomOverflowsNothingH11) {
  AcousticConfig config = plain_config();
  const EnergyHistogram h = late_field(rooms::shoe1(0.2, 1, 1e4), config, 1e4f * rooms::shoe1_source(), 1e4f * rooms::shoe1_listener());
  for (const float value : h.values()) EXPECT_EQ(value, 0.f);
}

TEST(PathTracer, SourceOneMillimetreFromAWallStaysFiniteH18H20) {
  AcousticConfig config = plain_config();
  config.rays = 4096;
  for (const bool diffuse_last_segment : {true, false}) {
    config.diffuse_last_segment = diffuse_last_segment;
    TraceStats stats;
    const auto room = rooms::shoe1(0.2, 0.5);
    const double near = total_energy(late_field(room, config, rooms::point(1.2, 1.5, 0.001), rooms::shoe1_listener(), &stats));
    EXPECT_TRUE(std::isfinite(near));
    EXPECT_EQ(stats.nonfinite_dropped, 0u);
    // No firefly: not louder than a source at 20 cm by more than the wall's mirror can add, and not silent either (path_tracer.h states
    // that this source comes out low).
    const double at_20_cm = total_energy(late_field(room, config, rooms::point(1.2, 1.5, 0.2), rooms::shoe1_listener()));
    EXPECT_LT(10 * std::log10(near / at_20_cm), 3.0) << diffuse_last_segment;
    EXPECT_GT(10 * std::log10(near / at_20_cm), -10.0) << diffuse_last_segment;
  }
}

TEST(PathTracer, PartsCanBeSwitchedOff) {
  AcousticConfig config;
  config.late = Switch::off;
  config.direct = Switch::off;
  const AcousticScene scene(rooms::shoe1(0.2, 0.3), config);
  EnergyResponse response;
  compute_energy_response(scene, EarlyCandidates(scene, rooms::shoe1_source()), rooms::shoe1_listener(), response);
  EXPECT_EQ(total_energy(response.late), 0.0);
  EXPECT_EQ(response.stats.rays, 0u);
  ASSERT_FALSE(response.arrivals.empty());
  for (const Arrival& arrival : response.arrivals) EXPECT_GT(arrival.order, 0);
}

TEST(PathTracer, AirIsAppliedPerBinO16) {
  // Same seed with and without air: the ratio of each bin is exp(-m c t).
  AcousticConfig config = plain_config();
  config.bands = 0;
  config.sample_rate_hz = 24000;  // all of the octave at 8 kHz
  config.rays = 32;
  const auto room = rooms::shoe1(0.1, 1);
  const EnergyHistogram without = late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
  config.air_absorption = Switch::automatic;
  const EnergyHistogram with = late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
  const double per_m[] = {2.820e-05, 0, 0, 0, 0, 0.006774, 0.023927};  // O-23 at exact midbands: 29.419 and 103.91 dB/km
  for (const int band : {5, 6}) {
    const double expected = std::exp(-per_m[band] * 343.0 * 50.5 * 0.004);
    EXPECT_NEAR(with.energy(50, band) / without.energy(50, band), expected, 2e-3 * expected);
  }
}

TEST(PathTracer, FirstOrderHarmonicsPointToTheSound) {
  // A single diffuse wall at x = 5 m: all energy comes from +x.
  std::array<Material, 6> walls = rooms::uniform_walls(1, 1);
  walls[1] = Material::uniform("diffuse", 0.f, 1.f);
  AcousticConfig config = plain_config();
  config.sh_order = 1;
  config.rays = 4096;
  const EnergyHistogram h = late_field(rooms::box(5, 4, 3, walls), config, rooms::shoe1_source(), rooms::shoe1_listener());
  double sum[4] = {};
  for (int i = 0; i < h.num_bins(); ++i)
    for (int k = 0; k < 4; ++k) sum[k] += h.at(i, 0)[k];
  // N3D: y = sqrt(3) times the direction cosine to the left, which is -x of the world.
  EXPECT_LT(sum[1] / (std::sqrt(3.0) * sum[0]), -0.5);
  EXPECT_GE(sum[1] / (std::sqrt(3.0) * sum[0]), -1.0);
  EXPECT_LT(std::hypot(sum[2], sum[3]), -sum[1]);
}

TEST(PathTracer, ManyBandsAgreeWithOneH29) {
  const auto room = rooms::shoe1(0.2, 0.5);
  AcousticConfig config = plain_config();
  const EnergyHistogram one_thread = late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
  for (const int bands : {2, 5, 8, 12, 16, 31, 32}) {
    config.bands = bands;
    const EnergyHistogram many_threads = late_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener());
    for (int band = 0; band < many_threads.num_bands(); ++band) {
      EXPECT_NEAR(total_energy(many_threads, band), total_energy(one_thread), 1e-5 * total_energy(one_thread)) << bands;
    }
  }
}

}  // namespace
}  // namespace earshot
