// SPDX-License-Identifier: Apache-2.0
// Rooms of a decimetre and of ten kilometres, and files in another unit than they seem (docs/evidence/stability.md, H-10 to H-12).

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/synthesis/rir_synthesis.h"
#include "sim/base/errors.h"
#include "sim/scene/scene_report.h"
#include "tests/support/files/leak_walk.h"
#include "tests/support/files/mesh_cases.h"

namespace earshot {
namespace {

using namespace mesh_cases;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const glm::vec3 kSource(1.2f, 1.1f, 1.5f), kListener(3.8f, 1.6f, 2.3f);

/// SHOE-1 with its corner at zero, all lengths and times times `scale`.
EnergyResponse respond(float scale, int rays) {
  AcousticConfig config;
  config.rays = rays;
  config.bands = 1;
  config.air_absorption = Switch::off;
  config.diffraction = Switch::off;
  config.late = Switch::on;
  config.rir_length_s = 0.4f * scale;
  config.time_bin_s = 0.004f * scale;
  config.source_radius_m = 0.25f * scale;
  const AcousticScene acoustics(scene_of(box(glm::dvec3(5, 3, 4) * double{scale}), 0.2f, 1.f), config);
  EnergyResponse response;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, scale * kSource), scale * kListener, response);
  return response;
}

// O-19: times scale with the lengths, energies with their inverse square.  With corners at zero, where an offset is absolute (1.5e-5 m,
// which is 1 mm in a room 64 times as large); a fixed offset of 1 cm would take 13 % of this room.  Away from zero: PathTracer.
// ScalingByPowersOfTwoKeepsBitsO19, to the bit.
TEST(H10_TinyRoom, GivesTheScaledResults) {
  const EnergyResponse whole = respond(1, 4000), tiny = respond(1.f / 64, 4000);
  ASSERT_EQ(tiny.arrivals.size(), whole.arrivals.size());
  for (std::size_t i = 0; i < whole.arrivals.size(); ++i) {
    EXPECT_EQ(64 * tiny.arrivals[i].distance_m, whole.arrivals[i].distance_m);
    EXPECT_EQ(tiny.arrivals[i].amplitude[0] / 64, whole.arrivals[i].amplitude[0]);
  }
  const auto total = [](const EnergyResponse& r) {
    double sum = 0;
    for (const double energy : r.late.band_energy(0)) sum += energy;
    return sum;
  };
  // The same directions from points that are moved by 2e-4 of the room: a few of 4,000 rays meet the other wall at an edge.
  EXPECT_NEAR(total(tiny) / (64 * 64 * total(whole)), 1, 2e-3);
  EXPECT_EQ(tiny.stats.ray_escapes, 0u);
}

TEST(H10_TinyRoom, KeepsItsRaysAtAnySize) {
  for (const double size_m : {1e-3, 0.1, 1e4}) {
    const auto scene = scene_of(box(glm::dvec3(size_m), glm::dvec3(-0.37 * size_m)));
    const LeakCounts leaks = walk_inside(scene->rays(), glm::dvec3(0.13 * size_m), 2 * size_m, 200'000);
    EXPECT_EQ(leaks.escapes, 0u) << size_m;
    EXPECT_EQ(leaks.same_triangle, 0u) << size_m;
  }
}

// 10 km: sound that needs 20 s to the listener is not in a response of half a second, and everything that follows is silent and finite.
TEST(H11_HugeRoom, ArrivesAfterTheEndAsSilence) {
  AcousticConfig config;
  config.rays = 200;
  config.late = Switch::on;
  const auto scene = scene_of(box({1e4, 1e4, 1e4}));
  const AcousticScene acoustics(scene, config);
  EnergyResponse response;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, glm::vec3(1000)), {8000, 6000, 7000}, response);
  EXPECT_THAT(response.arrivals, IsEmpty());
  for (const float value : response.late.values()) ASSERT_EQ(value, 0.f);
  RirSynthesizer synthesizer(make_synthesis_tables(config, acoustics.bands(), {}, Hrtf::rigid_sphere(config.sample_rate_hz)));
  Rir rir;
  synthesizer.render(response, ListenerOrientation(0.3), 7, rir);
  ASSERT_GT(rir.num_samples, 0);
  for (const float sample : rir.samples) ASSERT_EQ(sample, 0.f);
  // Near the source, the direct sound is there as in free air, and the walls are too late.
  compute_energy_response(acoustics, EarlyCandidates(acoustics, glm::vec3(5000)), {5010, 5000, 5000}, response);
  ASSERT_EQ(response.arrivals.size(), 1u);
  EXPECT_EQ(response.arrivals[0].distance_m, 10);
}

// A millisecond longer than the path, with the longest response there is: bins of 60 s and distances of 1e7 m stay in range.
TEST(H11_HugeRoom, LongestResponseInAHugeRoom) {
  AcousticConfig config;
  config.rays = 50;
  config.bands = 1;
  config.rir_length_s = 60;
  config.air_absorption = Switch::off;
  const auto scene = scene_of(box({1e4, 1e4, 1e4}), 0.1f, 0.f);
  const AcousticScene acoustics(scene, config);
  EnergyResponse response;
  compute_energy_response(acoustics, EarlyCandidates(acoustics, glm::vec3(5000, 5000, 2000)), {5000, 5000, 8000}, response);
  ASSERT_GE(response.arrivals.size(), 2u);
  EXPECT_EQ(response.arrivals[0].distance_m, 6000);
  for (const Arrival& arrival : response.arrivals) {
    EXPECT_LE(arrival.distance_m, 60 * 343.f);
    // Amplitude of an image: 1 / (4 pi r) times sqrt(0.9) per wall.
    EXPECT_NEAR(arrival.amplitude[0] * 4 * 3.14159265 * arrival.distance_m, std::pow(0.9, 0.5 * arrival.order), 1e-4);
  }
  for (const float value : response.late.values()) ASSERT_TRUE(std::isfinite(value));
  EXPECT_EQ(response.stats.ray_efficiency(), 1.0);
}

// From beyond all scenes, or from a position that is not finite: a valid answer, and no crash (Embree's, at 1e30 m).
TEST(X_RayFromNowhere, MeetsNothing) {
  const auto scene = scene_of(box({5, 3, 4}));
  const EmbreeScene& rays = scene->rays();
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  for (const float bad : {nan, infinity, -infinity, 1e16f, 1e30f, 3e38f}) {
    for (int axis = 0; axis < 3; ++axis) {
      glm::vec3 point(2, 1, 1.5f), direction(0.6f, 0.8f, 0);
      point[axis] = bad;
      direction[axis] = bad;
      EXPECT_FALSE(rays.intersect(point, {0.6f, 0.8f, 0}).valid()) << bad;
      EXPECT_FALSE(rays.intersect({2, 1, 1.5f}, direction).valid()) << bad;
      EXPECT_TRUE(rays.occluded(point, {2, 1, 1.5f})) << bad;
      EXPECT_TRUE(rays.occluded({2, 1, 1.5f}, point)) << bad;
      std::array<glm::vec3, 8> origins, directions;
      origins.fill({2, 1, 1.5f});
      directions.fill({0, -1, 0});
      origins[3] = point;
      directions[5] = direction;
      std::array<float, 8> distances{};
      rays.intersect8(origins, directions, distances);
      // Four units in the last place: processors differ in their reciprocals.
      for (std::size_t i = 0; i < 8; ++i) EXPECT_EQ(distances[i], i == 3 || i == 5 ? infinity : 1.f) << i;
    }
  }
  // As far as scenes go and a thousand times beyond, rays still find their way.
  const Hit hit = rays.intersect({2, 1, 1e12f}, {0, 0, -1});
  EXPECT_TRUE(hit.valid());
  EXPECT_NEAR(hit.distance_m, 1e12f, 1e5f);
}

TEST(H12_WrongUnit, IsWarnedAbout) {
  const auto warnings = [](double scale) { return import("room.obj", obj_text(box(glm::dvec3(6, 3, 4) * scale))).report.warnings; };
  EXPECT_THAT(warnings(1), IsEmpty());
  EXPECT_THAT(warnings(100), ElementsAre(HasSubstr("600 m in size: is the unit right?"))) << "centimetres taken for metres";
  EXPECT_THAT(warnings(1000), ElementsAre(HasSubstr("6000 m in size"))) << "millimetres";
  EXPECT_THAT(warnings(0.01), ElementsAre(HasSubstr("0.06 m in size")));
}

TEST(H12_WrongUnit, UnitIsTheScaleOfTheVertices) {
  const DoubleMesh metres = box({6, 3, 4}, {-2.5, 0, 1.25});
  for (const double unit_m : {0.01, 0.001, 0.0254, 0.3048, 0.5}) {
    DoubleMesh file = metres;
    for (glm::dvec3& v : file.vertices) v /= unit_m;
    const TriangleMesh scaled = import("room.obj", obj_text(file), {MeshImportOptions::Up::y, unit_m}).mesh,
                       expected = import("room.obj", obj_text(metres)).mesh;
    ASSERT_EQ(scaled.triangles, expected.triangles);
    for (std::size_t i = 0; i < expected.vertices.size(); ++i)
      EXPECT_LT(glm::length(scaled.vertices[i] - expected.vertices[i]), 1e-6f) << unit_m << ": a rounding of the file's floats";
  }
  const TempFolder folder;
  DoubleMesh centimetres = metres;
  for (glm::dvec3& v : centimetres.vertices) v *= 100;
  const std::string file = folder.write("room.obj", obj_text(centimetres));
  const Scene by_option = load_scene(file, {.unit_m = 0.01, .simplify_m = std::nullopt}),
              by_yaml = load_scene(folder.write("room.yaml", "mesh: room.obj\nunit_m: 0.01\n"));
  EXPECT_EQ(by_option.hash(), by_yaml.hash());
  EXPECT_EQ(by_option.hash(), load_scene(folder.write("metres.obj", obj_text(metres))).hash()) << "these coordinates are exact in both";
  for (const double bad : {0.0, -1.0, 1e9, std::nan("")})
    EXPECT_THROW(load_scene(file, {.unit_m = bad, .simplify_m = std::nullopt}), InputError) << bad;
}

}  // namespace
}  // namespace earshot
