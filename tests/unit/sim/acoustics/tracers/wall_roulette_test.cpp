// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/wall_roulette.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "sim/base/random.h"
#include "tests/support/acoustics/bidirectional_field.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr std::size_t kBands = 8;

struct Play {
  std::array<double, kBands> brought{}, expected{}, squares{};  // sums: what arrived, what should, squares
  int blocked = 0, followed = 0;
  double largest = 0;
};

/// Segments of which one in `free_every` is free, the others behind one or two walls that pass `passed`.
Play play(int segments, int free_every, std::array<float, kBands> passed, float decay) {
  Play result;
  WallRoulette<kBands> roulette;
  const RandomStream random(11, Purpose::test);
  float carried = 1.f;
  for (int i = 0; i < segments; ++i) {
    const auto u = random.uniform4(static_cast<std::uint32_t>(i));
    const float geometry = 0.1f + u[0];
    carried *= decay;
    if (u[1] * static_cast<float>(free_every) < 1.f) {
      roulette.arrive_freely(geometry);
      continue;
    }
    ++result.blocked;
    float energy[kBands];
    for (float& band : energy) band = carried * geometry;
    const int walls = u[2] < 0.5f ? 1 : 2;
    std::array<double, kBands> expected;
    for (std::size_t b = 0; b < kBands; ++b) expected[b] = geometry * std::pow(double{passed[b]}, walls);
    bool arrives = roulette.begin(energy, geometry, u[3]);
    for (int wall = 0; arrives && wall < walls; ++wall) {
      arrives = roulette.goes_on(energy, passed.data());
      result.followed += arrives ? 1 : 0;
      for (std::size_t b = 0; b < kBands; ++b) energy[b] *= passed[b];
    }
    for (std::size_t b = 0; b < kBands; ++b) result.expected[b] += expected[b];
    if (!arrives) {
      roulette.lose();
      continue;
    }
    roulette.arrive(energy);
    for (std::size_t b = 0; b < kBands; ++b) {
      const double brings = double{energy[b]} / double{carried};
      result.brought[b] += brings;
      result.squares[b] += brings * brings;
      result.largest = std::max(result.largest, brings);
    }
  }
  return result;
}

// Walls of 20 to 50 dB in a house with one segment in ten free: hardly any is followed, no mean moves, and nothing that arrives is louder
// than a free segment.
TEST(WallRoulette, KeepsEveryMeanAndBringsNothingLoud) {
  const Play house = play(400'000, 10, {1e-2f, 5e-3f, 2e-3f, 1e-3f, 5e-4f, 2e-4f, 1e-4f, 1e-5f}, 0.9999f);
  EXPECT_LT(house.followed, house.blocked / 5);
  EXPECT_LT(house.largest, 1.1);
  for (std::size_t b = 0; b < kBands; ++b)
    EXPECT_NEAR(house.brought[b], house.expected[b], 4 * std::sqrt(house.squares[b])) << "band " << b;
  for (std::size_t b = 0; b < kBands; ++b) EXPECT_LT(4 * std::sqrt(house.squares[b]), 0.3 * house.expected[b]) << "band " << b;
}

// Where all that arrives comes through walls it is followed: through one wall nearly always.
TEST(WallRoulette, FollowsWallsWhereNothingElseArrives) {
  const Play closed = play(100'000, 1 << 30, {1e-3f, 1e-3f, 1e-3f, 1e-4f, 1e-4f, 1e-4f, 1e-5f, 1e-5f}, 1.f);
  EXPECT_GT(closed.followed, closed.blocked * 9 / 10);
  for (std::size_t b = 0; b < kBands; ++b) EXPECT_NEAR(closed.brought[b], closed.expected[b], 0.03 * closed.expected[b]) << "band " << b;
}

// Two rooms, a wall of 20 dB with an open end between them, source and listener out of sight: few rays bring what the bidirectional tracer
// finds, which follows every segment.
TEST(WallRoulette, LateFieldBehindAWallIsThatOfBothEnds) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 4, 3}, 0);
  rooms::append_quad(mesh, {rooms::point(3, 0, 0), rooms::point(3, 3.2, 0), rooms::point(3, 3.2, 3), rooms::point(3, 0, 3)}, 1);
  const auto rooms_of_two =
      rooms::scene_of(std::move(mesh), {Material::uniform("wall", 0.3f, 1.f), Material::uniform("sheet", 0.5f, 1.f, 0.01f)});
  const auto source = rooms::point(1, 1, 1.2), listener = rooms::point(5, 1.3, 1.6);
  AcousticConfig config = rooms::plain_config();
  config.transmission = Switch::on;
  config.rir_length_s = 0.3f;
  config.diffuse_last_segment = true;  // with full scattering that is exact
  AcousticConfig both = config;
  both.rays = both.source_rays = 8192;
  const rooms::Sample expected = rooms::bidirectional_field(rooms_of_two, both, SoundSource{source}, listener).total();
  config.rays = 256;
  const rooms::Sample energy = rooms::over_seeds(60, config, [&](const AcousticConfig& c) {
    double sum = 0;
    for (const double value : rooms::late_field(rooms_of_two, c, source, listener).band_energy(0)) sum += value;
    return sum;
  });
  rooms::expect_same(energy, expected, 4, 0.03);
}

}  // namespace
}  // namespace earshot
