// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "sim/acoustics/paths/transmission.h"
#include "tests/support/acoustics/bidirectional_field.h"
#include "tests/support/acoustics/photon_tracer.h"

namespace earshot {
namespace {

using rooms::bidirectional_config;
using rooms::bidirectional_field;
using rooms::expect_near;
using rooms::expect_same;
using rooms::photon_energy;
using rooms::PhotonRoom;
using rooms::Sample;

TEST(BidirectionalSlow, O10_EqualsNextEventEstimationAndPhotons) {
  AcousticConfig config = bidirectional_config(32768);
  config.rir_length_s = 0.4f;
  for (const double scattering : {0.1, 0.5, 1.0}) {
    const auto room = rooms::shoe1(0.2, scattering);
    const Sample both = bidirectional_field(room, config, rooms::shoe1_source(), rooms::shoe1_listener()).total();
    AcousticConfig rooted = config;
    rooted.source_rays = 0;
    rooted.rays = 4096;
    const Sample next_event = rooms::over_seeds(8, rooted, [&](const AcousticConfig& c) {
      return rooms::total_energy(rooms::late_field(room, c, rooms::shoe1_source(), rooms::shoe1_listener()));
    });
    const Sample photons =
        photon_energy({.absorption = 0.2, .scattering = scattering}, {1.2, 1.5, 1.1}, {3.8, 2.3, 1.6}, 0.3, 0.4, 200'000);
    expect_same(both, next_event, 3, 0.025, "next event");
    expect_same(both, photons, 3, 0.025, "photons");
  }
}

/// Two rooms of 5 x 4 x 3 m with a common wall at x = 5 m: a sheet, or a closed box of the given thickness inside the second room.
std::shared_ptr<const Scene> two_rooms(double absorption, double scattering, double wall_absorption, double tau, double thickness_m = 0) {
  TriangleMesh mesh;
  const auto at = [](double x, int j, int k) { return rooms::point(x, j * 4.0, k * 3.0); };
  const double far = 10 + thickness_m, mid = 5 + thickness_m;
  rooms::append_quad(mesh, {at(0, 0, 0), at(0, 1, 0), at(0, 1, 1), at(0, 0, 1)}, 0);
  rooms::append_quad(mesh, {at(far, 0, 0), at(far, 1, 0), at(far, 1, 1), at(far, 0, 1)}, 0);
  rooms::append_quad(mesh, {at(0, 0, 0), at(far, 0, 0), at(far, 0, 1), at(0, 0, 1)}, 0);
  rooms::append_quad(mesh, {at(0, 1, 0), at(far, 1, 0), at(far, 1, 1), at(0, 1, 1)}, 0);
  rooms::append_quad(mesh, {at(0, 0, 0), at(far, 0, 0), at(far, 1, 0), at(0, 1, 0)}, 0);
  rooms::append_quad(mesh, {at(0, 0, 1), at(far, 0, 1), at(far, 1, 1), at(0, 1, 1)}, 0);
  rooms::append_quad(mesh, {at(5, 0, 0), at(5, 0, 1), at(5, 1, 1), at(5, 1, 0)}, 1);
  // The far face winds the other way: both normals point out of the wall.
  if (thickness_m > 0) rooms::append_quad(mesh, {at(mid, 0, 0), at(mid, 1, 0), at(mid, 1, 1), at(mid, 0, 1)}, 1);
  return rooms::scene_of(std::move(mesh), {Material::uniform("wall", static_cast<float>(absorption), static_cast<float>(scattering)),
                                           Material::uniform("partition", static_cast<float>(wall_absorption),
                                                             static_cast<float>(scattering), static_cast<float>(tau))});
}

AcousticConfig transmitting_config(int rays) {
  AcousticConfig config = bidirectional_config(rays);
  config.transmission = Switch::on;
  config.diffraction = Switch::off;
  config.rir_length_s = 0.8f;
  return config;
}

TEST(BidirectionalSlow, O22_LevelBehindAWall) {
  const glm::vec3 source = rooms::point(1.2, 1.5, 1.1), same_room = rooms::point(3.0, 2.6, 1.7), next_room = rooms::point(7.5, 1.4, 1.3);
  const double absorption = 0.1, tau = 0.05;
  const auto room = two_rooms(absorption, 1, absorption, tau);
  const AcousticConfig config = transmitting_config(16384);
  const Sample same_energy = bidirectional_field(room, config, source, same_room).total();
  const Sample next_energy = bidirectional_field(room, config, source, next_room).total();

  const PhotonRoom photons{.two_rooms = true, .absorption = absorption, .wall_absorption = absorption, .wall_transmission = tau};
  expect_same(same_energy, photon_energy(photons, {1.2, 1.5, 1.1}, {3.0, 2.6, 1.7}, 0.4, 0.8, 60'000), 3, 0.03, "same room");
  expect_same(next_energy, photon_energy(photons, {1.2, 1.5, 1.1}, {7.5, 1.4, 1.3}, 0.4, 0.8, 300'000), 3, 0.04, "next room");

  // D = TL + 10 log10(A2 / S): 13.01 + 10 log10(9.4 / 12).  1 dB: in rooms of this size the level falls away from where sound enters;
  // tau taken at both faces, or as a pressure, would be 13 dB off.
  const double difference_db = 10 * std::log10(same_energy.mean / next_energy.mean);
  EXPECT_NEAR(difference_db, 13.0103 + 10 * std::log10(9.4 / 12.0), 1.0) << next_energy.standard_error / next_energy.mean;

  // Reciprocal.
  expect_same(next_energy, bidirectional_field(room, config, next_room, source).total(), 4, 0.03, "swapped");

  // The listener-rooted tracer, with last segments through the wall by chance and by sight.
  for (const bool diffuse_last_segment : {false, true}) {
    AcousticConfig rooted = config;
    rooted.source_rays = 0;
    rooted.rays = 2048;
    rooted.diffuse_last_segment = diffuse_last_segment;
    const Sample alone = rooms::over_seeds(
        8, rooted, [&](const AcousticConfig& c) { return rooms::total_energy(rooms::late_field(room, c, source, next_room)); });
    expect_same(next_energy, alone, 4, 0.08, diffuse_last_segment ? "rooted, by sight" : "rooted, by chance");
  }
}

TEST(BidirectionalSlow, O22_AThickWallPassesWhatASheetPasses) {
  const glm::vec3 source = rooms::point(1.2, 1.5, 1.1), behind = rooms::point(7.6, 1.4, 1.3);
  const AcousticConfig config = transmitting_config(8192);
  const Sample sheet = bidirectional_field(two_rooms(0.1, 1, 0.1, 0.05), config, source, behind - rooms::point(0.1, 0, 0)).total();
  const Sample box = bidirectional_field(two_rooms(0.1, 1, 0.1, 0.05, 0.1), config, source, behind).total();
  // The path is 10 cm longer: 1 % at most.  A factor tau for each face would be 13 dB.
  EXPECT_NEAR(box.mean, sheet.mean, 0.02 * sheet.mean + 4 * std::hypot(box.standard_error, sheet.standard_error));
  EXPECT_LT(box.standard_error, 0.04 * box.mean);
}

TEST(BidirectionalSlow, O18_ReflectedTransmittedAndDissipatedAddUp) {
  // Nothing absorbed but what passes the partition, and that comes back: the level of both rooms is c / (4 pi 2 V) per second in the end.
  const auto room = two_rooms(0, 1, 0.5, 0.5);
  AcousticConfig config = transmitting_config(4096);
  config.rir_length_s = 0.4f;
  for (const double x : {3.8, 7.0}) {
    const auto field = bidirectional_field(room, config, rooms::shoe1_source(), rooms::point(x, 2.3, 1.6));
    expect_near(field.sum(0, [](double t) { return t > 0.2 && t < 0.4 ? 5.0 : 0.0; }), 0.454921 / 2, 4, 0.03);
    // Where walls meet without a common edge a passed wall may let a ray out: once in 1e5 segments at most.
    EXPECT_LT(static_cast<double>(field.stats.ray_escapes), 1e-5 * static_cast<double>(field.stats.ray_hits));
  }
}

TEST(BidirectionalSlow, O22_SwitchedOffLeavesNoTrace) {
  // The same bits as a wall that lets nothing through, in both tracers.
  AcousticConfig config = transmitting_config(256);
  config.transmission = Switch::off;
  const auto leaky = two_rooms(0.1, 0.6, 0.1, 0.05), tight = two_rooms(0.1, 0.6, 0.1, 0);
  const auto listener = rooms::point(3.0, 2.6, 1.7);
  const auto same_bits = [](const EnergyHistogram& a, const EnergyHistogram& b) {
    return std::equal(a.values().begin(), a.values().end(), b.values().begin());
  };
  EXPECT_TRUE(same_bits(bidirectional_field(leaky, config, rooms::shoe1_source(), listener).histogram,
                        bidirectional_field(tight, config, rooms::shoe1_source(), listener).histogram));
  config.source_rays = 0;
  EXPECT_TRUE(same_bits(rooms::late_field(leaky, config, rooms::shoe1_source(), listener),
                        rooms::late_field(tight, config, rooms::shoe1_source(), listener)));
  AcousticConfig on = config;
  on.transmission = Switch::on;
  EXPECT_TRUE(same_bits(rooms::late_field(tight, on, rooms::shoe1_source(), listener),
                        rooms::late_field(tight, config, rooms::shoe1_source(), listener)));
}

}  // namespace
}  // namespace earshot
