// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "sim/acoustics/model/effect_plan.h"
#include "sim/acoustics/tracers/path_tracer.h"
#include "tests/support/acoustics/acoustic_engines.h"

/// Walls that keep everything, nothing, or hardly any of it, and scenes that are hardly rooms.
namespace earshot {
namespace {

using namespace engines;

/// First reflections of SHOE-1 by Lambert walls that keep everything, all six walls (docs/evidence/oracles.md, O-8).
constexpr double kFirstReflections = 3.315472e-04 + 3.393299e-04 + 3.373553e-04 + 2.868505e-04 + 5.257685e-04 + 4.373527e-04;

TEST(H18_GrazingRays, NoSingleContributionIsAFirefly) {
  // O-8 with the floor alone: single rays, each its own estimate of 5.258e-4 (bidirectional: and single source paths).
  std::array<Material, 6> walls = rooms::uniform_walls(1, 1);
  walls[4] = Material::uniform("diffuse", 0.f, 1.f);
  const auto room = rooms::box(5, 4, 3, walls);
  for (const Engine engine : {Engine::path_tracer, Engine::bidirectional}) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config = plain(1);
    config.max_bounces = 1;
    const Heard heard(engine, room, config, rooms::shoe1_source());
    constexpr int kRays = 20'000;
    double sum = 0, largest = 0;
    EnergyResponse response;
    for (int ray = 0; ray < kRays; ++ray) {
      const AcousticScene single_ray = heard.scene.with_rays(1, static_cast<std::uint64_t>(ray));
      compute_energy_response(single_ray, heard.candidates, rooms::shoe1_listener(), response);
      ASSERT_EQ(response.stats.nonfinite_dropped, 0u);
      const double energy = late_energy(response);
      sum += energy;
      largest = std::max(largest, energy);
    }
    EXPECT_LT(largest, 100 * sum / kRays);
    EXPECT_NEAR(sum / kRays, 5.257685e-04, 0.06 * 5.257685e-04);  // a spread of 1 to 2 per ray: three sigma of 20,000
  }
}

TEST(H18_GrazingRays, SourceAndListenerAMicrometreAboveTheFloor) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    for (const double scattering : {0.0, 0.5, 1.0}) {
      const Heard heard(engine, rooms::shoe1(0.1, scattering), plain(512), rooms::point(1.2, 1.5, 1e-6), 512);
      const EnergyResponse response = heard.at(rooms::point(3.8, 2.3, 1e-6));
      expect_sound(response);
      if (scattering > 0) {
        EXPECT_GT(late_energy(response), 0.0);
      }
    }
  }
}

TEST(H20_SourceAMillimetreFromAWall, TheFieldKeepsTheTrend) {
  // Photons leave the source itself, so no connection has a 1 / d^2.  Level against height is smooth: 1 mm continues what 5 and 10 cm say.
  constexpr int kSeeds = 4;
  const auto room = rooms::shoe1(0.2, 1);
  const auto at_height = [&](double height_m) {
    double sum = 0, squares = 0;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      AcousticConfig config = plain();
      config.seed = static_cast<std::uint64_t>(seed);
      const Heard heard(Engine::field, room, config, rooms::point(1.2, 1.5, height_m), 8192);
      const double energy = late_energy(heard.at(rooms::shoe1_listener()));
      sum += energy / kSeeds;
      squares += energy * energy / kSeeds;
    }
    return std::array{sum, std::sqrt(std::max(squares - sum * sum, 0.0) / (kSeeds - 1))};
  };
  const auto near = at_height(0.001), at_5_cm = at_height(0.05), at_10_cm = at_height(0.10);
  const double extrapolated = at_5_cm[0] - 0.98 * (at_10_cm[0] - at_5_cm[0]);
  const double error = std::hypot(near[1], 1.98 * at_5_cm[1], 0.98 * at_10_cm[1]);
  EXPECT_NEAR(near[0], extrapolated, 0.01 * extrapolated + 3 * error) << near[0] << " " << at_5_cm[0] << " " << at_10_cm[0];
  EXPECT_LT(error, 0.05 * extrapolated);
}

TEST(H21_RigidClosedRoom, EnergyStaysAndNoEngineRunsForever) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config = plain(1024);
    config.rir_length_s = 0.4f;
    const Heard heard(engine, rooms::shoe1(0, 1), config, rooms::shoe1_source(), 4096);
    const EnergyResponse response = heard.at(rooms::shoe1_listener());
    expect_sound(response);
    std::array<double, 3> windows{};
    for (std::size_t i = 25; i < 100; ++i) windows[(i - 25) / 25] += response.late.energy(static_cast<int>(i), 0);
    // c / (4 pi V) = 0.454921 per second at all times; without the 4 pi it would be 5.7.
    for (const double energy : windows) EXPECT_NEAR(energy / 0.1, 0.454921, 0.06 * 0.454921);
    const RoomMetrics metrics = measure(heard.scene, response);
    EXPECT_FALSE(metrics.bands[0].rt60_s || metrics.bands[0].edt_s || metrics.bands[0].t20_s);
    EXPECT_TRUE(metrics.bands[0].decay == DecayStatus::no_decay || metrics.bands[0].decay == DecayStatus::cut_short)
        << name_of(metrics.bands[0].decay);
    expect_sound(metrics);
  }
}

TEST(H21_RigidClosedRoom, AutomaticLengthIsTheLongest) {
  AcousticConfig config = plain(64);
  config.rir_length_s = 0;
  const AcousticScene scene(rooms::shoe1(0, 1), config);
  EXPECT_EQ(scene.config().rir_length_s, 4.f);
  for (const EffectDecision& decision : scene.plan().decisions) EXPECT_FALSE(std::isinf(decision.saved_ms)) << decision.effect;
}

TEST(H22_EverythingAbsorbed, OnlyTheDirectSoundIsLeft) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    for (const Switch late : {Switch::automatic, Switch::on}) {
      AcousticConfig config;
      config.rays = 256;
      config.late = late;
      const Heard heard(engine, rooms::shoe1(1, 0.5), config, rooms::shoe1_source(), 512);
      const EnergyResponse response = heard.at(rooms::shoe1_listener());
      expect_sound(response);
      for (const float value : response.late.values()) ASSERT_EQ(value, 0.f);
      ASSERT_EQ(response.arrivals.size(), 1u);
      const RoomMetrics metrics = measure(heard.scene, response);
      expect_sound(metrics);
      EXPECT_FALSE(metrics.drr_db);
      for (const BandMetrics& band : metrics.bands) {
        EXPECT_FALSE(band.rt60_s || band.edt_s || band.drr_db || band.c50_db);
        EXPECT_EQ(band.decay, DecayStatus::no_reverberation);
        EXPECT_EQ(*band.d50, 1.0);
        EXPECT_EQ(*band.ts_s, 0.0);
      }
    }
  }
}

TEST(H23_NearlyAllAndNearlyNothing, FirstReflectionsOfAMillionth) {
  // 1 - 1e-7 is 1 - 2^-23 in float: the walls keep 1.19e-7, and the late field is that times the first reflections of O-8.
  const double reflected = 1.0 - static_cast<double>(static_cast<float>(1 - 1e-7));
  ASSERT_GT(reflected, 0);
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config = plain(8192);
    config.late = Switch::on;
    const Heard heard(engine, rooms::shoe1(1 - 1e-7, 1), config, rooms::shoe1_source(), 16'384);
    const EnergyResponse response = heard.at(rooms::shoe1_listener());
    expect_sound(response);
    EXPECT_NEAR(db(late_energy(response) / (reflected * kFirstReflections)), 0.0, 0.25);
  }
}

TEST(H23_NearlyAllAndNearlyNothing, ATenMillionthOfAbsorptionIsARigidRoom) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config = plain(1024);
    config.rir_length_s = 0.4f;
    const Heard soft(engine, rooms::shoe1(1e-7, 1), config, rooms::shoe1_source()),
        rigid(engine, rooms::shoe1(0, 1), config, rooms::shoe1_source());
    const EnergyResponse response = soft.at(rooms::shoe1_listener());
    expect_sound(response);
    // The same paths; 160 reflections at most take 2e-5 of them.
    EXPECT_NEAR(late_energy(response) / late_energy(rigid.at(rooms::shoe1_listener())), 1.0, 3e-5);
  }
}

TEST(H24_OneTriangle, DirectSoundAtMostOneMirrorAndThreeEdges) {
  TriangleMesh mesh;
  mesh.vertices = {{-1, 0, -1}, {1, 0, -1}, {0, 0, 1}};
  mesh.triangles = {{0, 1, 2}};
  mesh.triangle_material = {0};
  mesh.triangle_object = {0};
  const auto scene = rooms::scene_of(mesh, {Material::uniform("plate", 0.1f, 0.3f)});
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config;
    config.rays = 4096;
    config.diffraction = Switch::on;
    const Heard heard(engine, scene, config, glm::vec3(0.1f, 1, -0.5f), 2048);
    for (const glm::vec3 listener : {glm::vec3(-0.2f, 1.2f, -0.3f), glm::vec3(0.1f, -1, -0.4f), glm::vec3(5, 0, 0), glm::vec3(0, 0, 0)}) {
      const EnergyResponse response = heard.at(listener);
      expect_sound(response);
      const bool behind = listener.y < 0;
      EXPECT_EQ(engines::count(response, ArrivalKind::direct), behind ? 0u : 1u);
      EXPECT_LE(engines::count(response, ArrivalKind::reflection), listener.y > 0 ? 1u : 0u);
      EXPECT_LE(engines::count(response, ArrivalKind::diffraction), 3u);
      EXPECT_LT(late_energy(response), 1.0);
      expect_sound(measure(heard.scene, response));
      // A plate sends nothing back from itself: one bounce each, then away.
      if (engine == Engine::path_tracer) {
        EXPECT_LE(response.stats.ray_hits, 4096u);
      }
    }
  }
}

TEST(H25_EmptyScene, IsTheFreeField) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    for (const Switch late : {Switch::automatic, Switch::on}) {
      AcousticConfig config;
      config.late = late;
      config.air_absorption = Switch::off;
      const Heard heard(engine, rooms::empty(), config, glm::vec3(3, 0, 4), 512);
      const EnergyResponse response = heard.at({0, 0, 0});
      expect_sound(response);
      ASSERT_EQ(response.arrivals.size(), 1u);
      EXPECT_NEAR(response.arrivals[0].amplitude[0], 1 / (4 * std::numbers::pi * 5), 1e-7);
      for (const float value : response.late.values()) ASSERT_EQ(value, 0.f);
      EXPECT_EQ(measure(heard.scene, response).bands[0].decay, DecayStatus::no_reverberation);
    }
  }
}

}  // namespace
}  // namespace earshot
