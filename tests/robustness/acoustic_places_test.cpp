// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "sim/acoustics/paths/transmission.h"
#include "sim/acoustics/response/position_check.h"
#include "sim/acoustics/tracers/bidirectional_tracer.h"
#include "sim/base/errors.h"
#include "sim/scene/air_sample.h"
#include "tests/support/acoustics/acoustic_engines.h"
#include "tests/support/acoustics/late_field.h"

/// Sources and listeners where no one would put them.
namespace earshot {
namespace {

using namespace engines;

TEST(H13_SourceEqualsListener, IsFiniteAndLooksAhead) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    const Heard heard(engine, rooms::shoe1(0.2, 1), plain(), rooms::shoe1_listener());
    const EnergyResponse repeated = heard.at(rooms::shoe1_listener());
    expect_sound(repeated);
    ASSERT_EQ(repeated.arrivals.size(), 1u);
    EXPECT_NEAR(repeated.arrivals[0].amplitude[0], 1 / (4 * std::numbers::pi * 0.01), 1e-6 / (4 * std::numbers::pi * 0.01));
    EXPECT_EQ(repeated.arrivals[0].direction, glm::vec3(0, 0, -1));
    EXPECT_EQ(repeated.arrivals[0].distance_m, 0.01f);
    // The room answers as it does 2 cm away: the density of first reflections from walls 1.3 m off changes by some per cent at most.
    EXPECT_NEAR(db(late_energy(repeated) / late_energy(heard.at(rooms::shoe1_listener() + glm::vec3(0.02f, 0, 0)))), 0.0, 0.15);
    // And as loudly as a diffuse field of the room constant (O-12: 0.0135), give or take what is near.
    EXPECT_NEAR(db(late_energy(repeated) / 0.01354), 0.0, 1.5);
    expect_sound(measure(heard.scene, repeated));
  }
}

TEST(H13_SourceEqualsListener, SoundsLikeAnImpulse) {
  AcousticConfig config = plain(64);
  const Heard heard(Engine::path_tracer, rooms::empty(), config, glm::vec3(1, 2, 3));
  const EnergyResponse response = heard.at({1, 2, 3});
  RirSynthesizer synthesizer(make_synthesis_tables(heard.scene.config(), heard.scene.bands(), ChannelLayout::binaural, nullptr));
  Rir rir;
  synthesizer.render(response, 1.0, 1, rir);
  double energy = 0;
  for (const float sample : rir.samples) {
    ASSERT_TRUE(std::isfinite(sample));
    energy += double{sample} * sample;
  }
  EXPECT_GT(energy, 0.1 * std::pow(1 / (4 * std::numbers::pi * 0.01), 2));
}

TEST(H14_SourceANanometreAway, IsContinuousAtTheLeastDistance) {
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    const glm::vec3 listener(0, 1.5f, 0);  // coordinates near zero keep a nanometre
    const auto room = rooms::scene_of(
        [] {
          TriangleMesh mesh;
          rooms::append_box(mesh, {-2, -2, 0}, {3, 2, 3}, 0);
          return mesh;
        }(),
        {Material::uniform("wall", 0.2f, 1.f)});
    const Heard heard(engine, room, plain(512), listener);
    const EnergyResponse repeated = heard.at(listener);
    double before = 1e9;
    for (const double apart_m : {1e-9, 1e-6, 1e-3, 0.00999, 0.01, 0.01001, 0.011, 0.02, 0.1}) {
      const EnergyResponse near = heard.at(listener + glm::vec3(static_cast<float>(apart_m), 0, 0));
      expect_sound(near);
      ASSERT_EQ(near.arrivals.size(), 1u) << apart_m;
      const Arrival& direct = near.arrivals[0];
      EXPECT_NEAR(direct.amplitude[0], 1 / (4 * std::numbers::pi * std::max(apart_m, 0.01)), 2e-6 / (4 * std::numbers::pi * 0.01))
          << apart_m;
      EXPECT_LE(direct.amplitude[0], before);
      before = direct.amplitude[0];
      EXPECT_NEAR(glm::length(direct.direction), 1.f, 1e-6f);
      EXPECT_LT(direct.direction.x, -0.999f) << apart_m;
      if (apart_m < 0.01) {
        EXPECT_NEAR(db(late_energy(near) / late_energy(repeated)), 0.0, 0.15) << apart_m;
      }
    }
  }
}

/// Two rooms with a solid wall of 20 cm between them, modelled as a box that ends `gap_m` before the shell, and a cupboard.
std::shared_ptr<const Scene> rooms_with_a_solid_wall(double gap_m) {
  const auto outward = [](TriangleMesh& mesh, glm::dvec3 lower, glm::dvec3 upper) {
    const std::size_t first = mesh.triangles.size();
    rooms::append_box(mesh, lower, upper, 0);
    for (std::size_t i = first; i < mesh.triangles.size(); ++i) std::swap(mesh.triangles[i].y, mesh.triangles[i].z);
  };
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {9, 4, 3}, 0);
  outward(mesh, {4, gap_m, gap_m}, {4.2, 4 - gap_m, 3 - gap_m});
  outward(mesh, {7, 1, 0.001}, {8, 2, 2});
  return rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.2f, 0.5f)});
}

TEST(H15_InsideAWall, IsFoundByFiveRays) {
  const auto scene = rooms_with_a_solid_wall(0.001);
  const PositionCheck places(*scene);
  ASSERT_TRUE(places.has_consistent_windings());
  for (double y = 0.3; y < 3.95; y += 0.3)
    for (double z = 0.3; z < 2.95; z += 0.3) {
      EXPECT_TRUE(places.inside_solid(rooms::point(4.1, y, z))) << y << " " << z;
      EXPECT_FALSE(places.inside_solid(rooms::point(3.9, y, z))) << y << " " << z;
      EXPECT_FALSE(places.inside_solid(rooms::point(4.3, y, z))) << y << " " << z;
    }
  EXPECT_TRUE(places.inside_solid(rooms::point(7.5, 1.5, 1)));
  EXPECT_FALSE(places.inside_solid(rooms::point(8.5, 1.5, 1)));
  EXPECT_FALSE(places.inside_solid(rooms::point(-5, 1, 1)));  // outside: nothing is around
}

TEST(H15_InsideAWall, AirOfHousesIsNot) {
  for (const char* name : {"house:1", "house:4", "shoebox:5x3x4@0.2"}) {
    const Scene scene = load_scene(name);
    const PositionCheck places(scene);
    int inside = 0;
    const auto points = sample_air(scene, 7).points;
    ASSERT_GT(points.size(), 100u);
    for (const glm::vec3 point : points) inside += places.inside_solid(point);
    EXPECT_LE(inside, static_cast<int>(points.size() / 100)) << name << ", knows: " << places.has_consistent_windings();
  }
  EXPECT_FALSE(PositionCheck(*rooms::empty()).inside_solid({0, 0, 0}));
}

TEST(H15_InsideAWall, EveryEngineStaysFiniteAndHearsNothingThroughIt) {
  const auto scene = rooms_with_a_solid_wall(0);
  const glm::vec3 inside = rooms::point(4.1, 2.03, 1.51), outside = rooms::point(2, 2, 1.5);
  for (const Engine engine : kEngines) {
    SCOPED_TRACE(name_of(engine));
    AcousticConfig config;  // bands, image paths, air: everything on
    config.rays = 128;
    const Heard from_outside(engine, scene, config, outside), from_inside(engine, scene, config, inside);
    for (const EnergyResponse& response : {from_outside.at(inside), from_inside.at(outside)}) {
      expect_sound(response);
      EXPECT_EQ(engines::count(response, ArrivalKind::direct), 0u);
      EXPECT_EQ(late_energy(response), 0.0);  // opaque faces all round
      expect_sound(measure(from_outside.scene, response));
    }
    expect_sound(from_inside.at(inside));  // shut in together
    EXPECT_GT(late_energy(from_inside.at(inside + glm::vec3(0, 0.2f, 0))), 0.0);
  }
}

TEST(X_OnASurface, ExactlyOnAWallEdgeOrCornerEveryEngineStaysFinite) {
  // x = 0, y = 0 and the floor meet at the origin; walls, edges and corners of SHOE-1, as source, as listener, as both.
  const std::array<glm::vec3, 5> places = {rooms::point(2, 1.3, 0), rooms::point(0, 1.3, 1.1), rooms::point(2, 0, 0), rooms::point(0, 0, 0),
                                           rooms::point(5, 4, 3)};
  for (const Engine engine : kEngines) {
    AcousticConfig config;
    config.rays = 256;
    for (const double scattering : {0.0, 0.3, 1.0}) {
      const auto room = rooms::shoe1(0.2, scattering);
      const Heard inside(engine, room, config, rooms::shoe1_source(), 512);
      for (const glm::vec3 place : places) {
        SCOPED_TRACE(name_of(engine) + " " + std::to_string(place.x) + " " + std::to_string(place.y) + " " + std::to_string(place.z));
        const EnergyResponse listening = inside.at(place);
        expect_sound(listening);
        EXPECT_EQ(engines::count(listening, ArrivalKind::direct), 1u);
        const Heard on_surface(engine, room, config, place, 512);
        expect_sound(on_surface.at(rooms::shoe1_listener()));
        EXPECT_EQ(engines::count(on_surface.at(rooms::shoe1_listener()), ArrivalKind::direct), 1u);
        expect_sound(on_surface.at(place));
        expect_sound(measure(inside.scene, listening));
      }
    }
  }
}

TEST(X_WallOnACellBorder, TheFieldDoesNotLeakByRounding) {
  // A closed sheet exactly where two cells meet: what flies up to it ends on the border, give or take a rounding, and stays on its side.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {8, 3, 3}, 0);
  rooms::append_quad(mesh, {rooms::point(4, 0, 0), rooms::point(4, 3, 0), rooms::point(4, 3, 3), rooms::point(4, 0, 3)}, 0);
  const auto scene = rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.1f, 0.7f)});
  const Heard heard(Engine::field, scene, plain(), rooms::point(1, 1, 1), 4096);
  for (double x = 4.01; x < 8; x += 0.37)
    for (double y = 0.1; y < 3; y += 0.4) {
      EXPECT_EQ(late_energy(heard.at(rooms::point(x, y, 1.3))), 0.0) << x << " " << y;
    }
  EXPECT_GT(late_energy(heard.at(rooms::point(3.99, 1, 1.3))), 0.0);
}

TEST(X_NotAPlace, IsRefusedWithItsName) {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  constexpr float largest = std::numeric_limits<float>::max();
  const AcousticScene scene(rooms::shoe1(0.2, 0.5), AcousticConfig{});
  const EarlyCandidates candidates(scene, rooms::shoe1_source());
  EnergyResponse response;
  for (const glm::vec3 bad :
       {glm::vec3(nan, 0, 0), glm::vec3(0, infinity, 0), glm::vec3(0, 0, -infinity), glm::vec3(1e10f, 0, 0), glm::vec3(0, 0, largest)}) {
    EXPECT_THROW(compute_energy_response(scene, candidates, bad, response), InputError);
    EXPECT_THROW(EarlyCandidates(scene, bad), InputError);
  }
  SoundSource source(rooms::shoe1_source());
  source.radius_m = nan;
  EXPECT_THROW(EarlyCandidates(scene, source), InputError);
  try {
    compute_energy_response(scene, candidates, {nan, 0, 0}, response);
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("listener"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(scene.scene().name()), std::string::npos) << error.what();
  }
}

TEST(X_FarAway, AListenerAMillionKilometresOffHearsNothing) {
  for (const Engine engine : {Engine::path_tracer, Engine::bidirectional}) {
    const Heard heard(engine, rooms::shoe1(0.2, 0.5), plain(64), rooms::shoe1_source());
    for (const float far : {1e3f, 1e6f, 1e9f}) {
      const EnergyResponse response = heard.at({far, -far, far});
      EXPECT_TRUE(engines::is_finite(response)) << far;
      EXPECT_TRUE(response.arrivals.empty()) << far;
      EXPECT_EQ(late_energy(response), 0.0) << far;
    }
  }
}

}  // namespace
}  // namespace earshot
