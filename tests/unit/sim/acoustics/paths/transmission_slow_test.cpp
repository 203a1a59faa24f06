// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/acoustics/bidirectional_field.h"

/// docs/evidence/oracles.md, O-22, room to room: D = TL + 10 log10(A2 / S), S = 10 m2, A2 = 15 m2.
namespace earshot {
namespace {

using rooms::point;

/// Two halls 10 x 10 x 5 m with the wall x = 10 between them, in which a partition of 4 x 2.5 m lets energy through.  All else is tight.
/// A2 = 400 m2 times 0.0375.
std::shared_ptr<const Scene> two_halls(double tau) {
  constexpr double x_end = 20, y_end = 10, z_end = 5;
  TriangleMesh mesh;
  const auto quad_across = [&](double x, double y0, double y1, double z0, double z1, std::uint32_t material) {
    rooms::append_quad(mesh, {point(x, y0, z0), point(x, y1, z0), point(x, y1, z1), point(x, y0, z1)}, material);
  };
  quad_across(0, 0, y_end, 0, z_end, 0);
  quad_across(x_end, 0, y_end, 0, z_end, 0);
  for (const double y : {0.0, y_end})
    rooms::append_quad(mesh, {point(0, y, 0), point(x_end, y, 0), point(x_end, y, z_end), point(0, y, z_end)}, 0);
  for (const double z : {0.0, z_end})
    rooms::append_quad(mesh, {point(0, 0, z), point(x_end, 0, z), point(x_end, y_end, z), point(0, y_end, z)}, 0);
  quad_across(10, 0, 3, 0, z_end, 0);
  quad_across(10, 7, y_end, 0, z_end, 0);
  quad_across(10, 3, 7, 2.5, z_end, 0);
  quad_across(10, 3, 7, 0, 2.5, 1);
  const auto absorption = 0.0375f;
  return rooms::scene_of(std::move(mesh), {Material::uniform("tight", absorption, 1.f),
                                           Material::uniform("partition", absorption, 1.f, static_cast<float>(tau))});
}

TEST(O22_Transmission, RoomToRoomLevelDifference) {
  AcousticConfig config = rooms::plain_config();
  config.rays = 16'000;
  config.max_bounces = 10'000;
  config.rir_length_s = 5.f;  // T = 5.3 s: 0.3 % of the energy comes later, in both halls
  config.time_bin_s = 0.02f;
  config.transmission = Switch::on;
  for (const auto& [tau, expected_db] : {std::pair{0.03, 16.9897}, std::pair{0.01, 21.7609}}) {
    const auto scene = two_halls(tau);
    const SoundSource source(point(3, 4, 2));
    // Reverberant levels, away from the source and the partition.
    const rooms::Sample here = rooms::bidirectional_field(scene, config, source, point(6, 8, 3)).total();
    const rooms::Sample there = rooms::bidirectional_field(scene, config, source, point(17, 4, 2)).total();
    const double difference_db = 10 * std::log10(here.mean / there.mean);
    const double error_db = 10 / std::log(10.0) * std::hypot(here.standard_error / here.mean, there.standard_error / there.mean);
    RecordProperty("difference_db", fmt::format("{:.3f} +- {:.3f}, expected {:.3f}", difference_db, error_db, expected_db));
    // The formula takes both fields for diffuse: 0.5 dB for that (the early part near the source, A by Eyring 0.08 dB).
    EXPECT_LT(error_db, 0.25);
    EXPECT_NEAR(difference_db, expected_db, 0.5 + 3 * error_db) << tau << " +- " << error_db;
  }
}

}  // namespace
}  // namespace earshot
