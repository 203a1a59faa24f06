// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/acoustic_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <set>

#include "sim/acoustics/model/air_absorption.h"
#include "sim/acoustics/tracers/path_tracer.h"
#include "sim/base/errors.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

TEST(AcousticScene, CoefficientsAreBandMeans) {
  Material ramp = Material::uniform("ramp", 0.f, 0.2f);
  ramp.absorption = {{125.f, 4000.f}, {0.1f, 0.6f}};  // linear in log f: 0.1 per octave
  std::array<Material, 6> walls = rooms::uniform_walls(0.3, 0.7);
  walls[2] = ramp;
  AcousticConfig config;
  config.bands = 8;
  config.sample_rate_hz = 48000.f;
  const AcousticScene scene(rooms::box(5, 4, 3, walls), config);
  // The mean over a whole octave of a straight line is its value at the centre: 0.1, 0.2, ... from 125 Hz on, where the line is straight.
  for (int band = 2; band <= 5; ++band) EXPECT_NEAR(scene.reflectance(2)[band], 1.0 - 0.1 * band, 1e-5);
  EXPECT_NEAR(scene.reflectance(2)[7], 0.4, 1e-6);  // held above 4 kHz
  for (const float r : scene.reflectance(0)) EXPECT_NEAR(r, 0.7f, 1e-6f);
  for (const float s : scene.scattering(0)) EXPECT_NEAR(s, 0.7f, 1e-6f);
  for (int b = scene.num_bands(); b < scene.padded_bands(); ++b) EXPECT_EQ(scene.padded_reflectance(2)[b], 0.f);
}

TEST(AcousticScene, ScatteringMayBeOverridden) {
  Material material = Material::uniform("m", 0.1f, 0.f);
  material.scattering = {{125.f, 8000.f}, {0.1f, 0.7f}};
  std::array<Material, 6> walls;
  walls.fill(material);
  AcousticConfig config;
  const auto room = rooms::box(5, 4, 3, walls);
  const AcousticScene default_scene(room, config);
  EXPECT_LT(default_scene.scattering(0)[0], 0.15f);
  EXPECT_GT(default_scene.scattering(0)[6], 0.6f);
  config.scattering = 0.25f;
  const AcousticScene fixed(room, config);
  for (const float s : fixed.scattering(0)) EXPECT_EQ(s, 0.25f);
}

TEST(AcousticScene, TransmissionStaysBelowAbsorptionH27) {
  AcousticConfig config;
  const AcousticScene scene(rooms::box(5, 4, 3,
                                       [] {
                                         std::array<Material, 6> walls;
                                         walls.fill(Material::uniform("wrong", 0.1f, 0.f, 0.4f));
                                         return walls;
                                       }()),
                            config);
  for (const float t : scene.transmission(0)) EXPECT_NEAR(t, 0.1f, 1e-6f);
}

TEST(AcousticScene, AirFollowsTheSwitch) {
  AcousticConfig config;
  config.air_absorption = Switch::on;
  const auto room = rooms::shoe1(0.2, 1);
  const AcousticScene with(room, config);
  for (int b = 0; b < with.num_bands(); ++b) {
    EXPECT_FLOAT_EQ(with.air_energy_per_m()[b], static_cast<float>(air_absorption_energy_per_m(room->air(), with.bands().centre_hz[b])));
  }
  config.air_absorption = Switch::off;
  const AcousticScene without(room, config);
  for (const float m : without.air_energy_per_m()) EXPECT_EQ(m, 0.f);
  EXPECT_NE(with.hash(), without.hash());
}

TEST(AcousticScene, HashKnowsTheConfigButNotTheThreads) {
  const auto room = rooms::shoe1(0.2, 1);
  AcousticConfig config;
  const std::uint64_t base = AcousticScene(room, config).hash();
  config.threads = 7;
  EXPECT_EQ(AcousticScene(room, config).hash(), base);
  config.seed = 1;
  EXPECT_NE(AcousticScene(room, config).hash(), base);
  EXPECT_NE(AcousticScene(rooms::shoe1(0.3, 1), AcousticConfig{}).hash(), base);
}

TEST(AcousticScene, WithRaysIsTheSceneOfThatConfig) {
  AcousticConfig config = acoustic_preset("fast");
  const AcousticScene one(rooms::shoe1(0.2, 0.5), config);
  config.rays = 32;
  config.seed = 9;
  const AcousticScene made(rooms::shoe1(0.2, 0.5), config), copied = one.with_rays(32, 9);
  EXPECT_EQ(copied.hash(), made.hash());
  EnergyHistogram first = make_histogram(made), second = make_histogram(copied);
  trace_late(made, rooms::shoe1_source(), rooms::shoe1_listener(), first);
  trace_late(copied, rooms::shoe1_source(), rooms::shoe1_listener(), second);
  EXPECT_EQ(first.band_energy(3), second.band_energy(3));
  EXPECT_THROW((void)one.with_rays(-1, 0), InputError);
}

TEST(MirrorPlanes, BoxHasSix) {
  const AcousticScene scene(rooms::shoe1(0.2, 1), {});
  ASSERT_EQ(scene.planes().size(), 6u);
  double area = 0;
  for (const MirrorPlane& plane : scene.planes()) {
    area += plane.area_m2;
    EXPECT_NEAR(glm::length(plane.normal), 1.f, 1e-6f);
  }
  EXPECT_NEAR(area, 94.0, 1e-4);
  for (std::size_t t = 0; t < 12; t += 2) {  // two triangles per wall
    EXPECT_EQ(scene.plane_of_triangle()[t], scene.plane_of_triangle()[t + 1]);
    const MirrorPlane& plane = scene.planes()[scene.plane_of_triangle()[t]];
    EXPECT_EQ(plane.material, t / 2);
    for (int corner = 0; corner < 3; ++corner) {
      const glm::vec3 vertex = scene.scene().mesh().vertices[scene.scene().mesh().triangles[t][corner]];
      EXPECT_NEAR(glm::dot(plane.normal, vertex), plane.offset_m, 1e-5f);
    }
  }
}

TEST(MirrorPlanes, JoinsCoplanarPiecesOfEitherFacingAndKeepsStepsApart) {
  TriangleMesh mesh;
  const auto tile = [&](float x, float y, bool flip) {
    const glm::vec3 a(x, y, 0), b(x + 1, y, 0), c(x + 1, y, 1), d(x, y, 1);
    if (flip)
      rooms::append_quad(mesh, {d, c, b, a}, 0);
    else
      rooms::append_quad(mesh, {a, b, c, d}, 0);
  };
  tile(0, 0, false);
  tile(5, 0, true);                                                                                // not connected, other facing
  tile(8, 0.0005f, false);                                                                         // within a millimetre
  tile(10, 0.02f, false);                                                                          // a step of 2 cm
  rooms::append_quad(mesh, {glm::vec3(12, 0, 0), {13, 0.05f, 0}, {13, 0.05f, 1}, {12, 0, 1}}, 0);  // tilted by 2.9 degrees
  const MirrorPlanes found = find_mirror_planes(mesh);
  EXPECT_EQ(found.planes.size(), 3u);
  for (int t = 1; t < 6; ++t) EXPECT_EQ(found.plane_of_triangle[t], found.plane_of_triangle[0]);
  EXPECT_NE(found.plane_of_triangle[6], found.plane_of_triangle[0]);
  EXPECT_NE(found.plane_of_triangle[8], found.plane_of_triangle[0]);
}

TEST(MirrorPlanes, TiltedFarFromTheOriginStillOnePlane) {
  // A wall at 30 degrees, 1 km away, in 100 tiles: the grouping works about the centre of the scene.
  TriangleMesh mesh;
  const glm::dvec3 origin(1000, 0, 1000), u(std::sqrt(0.75), 0, 0.5), v(0, 1, 0);
  for (int i = 0; i < 10; ++i)
    for (int j = 0; j < 10; ++j) {
      const auto at = [&](int di, int dj) { return glm::vec3(origin + double(i + di) * u + double(j + dj) * v); };
      rooms::append_quad(mesh, {at(0, 0), at(1, 0), at(1, 1), at(0, 1)}, 0);
    }
  EXPECT_EQ(find_mirror_planes(mesh).planes.size(), 1u);
}

TEST(MirrorPlanes, EmptyAndDegenerate) {
  EXPECT_TRUE(find_mirror_planes({}).planes.empty());
  TriangleMesh mesh;
  rooms::append_quad(mesh, {glm::vec3(0), glm::vec3(0), glm::vec3(0), glm::vec3(0)}, 0);
  const MirrorPlanes found = find_mirror_planes(mesh);
  for (const MirrorPlane& plane : found.planes) EXPECT_TRUE(std::isfinite(plane.normal.x + plane.offset_m));
}

}  // namespace
}  // namespace earshot
