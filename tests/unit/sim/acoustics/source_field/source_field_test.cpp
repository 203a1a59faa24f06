// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/source_field.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "sim/acoustics/geometry/field_grid.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/field_image.h"
#include "sim/audio/head/ambisonics.h"
#include "sim/base/errors.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/acoustics/source_field_cases.h"

namespace earshot {
namespace {

using namespace source_fields;
using rooms::total_energy;

TEST(SourceField, LambertBoxHasTheExactEnergyO10) {
  // SHOE-1, s = 1: late energy and sums e exp(-sigma t) for sigma = 5, 10, 20, 40 / s.
  const double sigma[] = {5, 10, 20, 40}, sums[] = {0.0096258, 0.0078759, 0.0055258, 0.0030544};
  constexpr int kSeeds = 6;
  std::array<std::array<double, kSeeds>, 5> found;  // energy, then the four sums
  for (int seed = 0; seed < kSeeds; ++seed) {
    AcousticConfig config = field_config(16'384, 0.5f);
    config.seed = static_cast<std::uint64_t>(seed);
    const EnergyHistogram late = Field(rooms::shoe1(0.2, 1), config, rooms::shoe1_source()).at(rooms::shoe1_listener());
    found[0][seed] = total_energy(late);
    for (std::size_t i = 0; i < 4; ++i) found[i + 1][seed] = rooms::laplace_sum(late, sigma[i]);
  }
  for (std::size_t i = 0; i < 5; ++i) {
    double mean = 0, squares = 0;
    for (const double value : found[i]) mean += value / kSeeds;
    for (const double value : found[i]) squares += (value - mean) * (value - mean);
    const double standard_error = std::sqrt(squares / (kSeeds * (kSeeds - 1)));
    const double exact = i == 0 ? 0.012029 : sums[i - 1];
    EXPECT_LT(standard_error, 0.015 * exact);
    // The blur of half a metre is allowed one per cent; a lost 4 pi or factor of two is far outside.
    EXPECT_NEAR(mean, exact, 0.01 * exact + 3.5 * standard_error) << i;
  }
}

TEST(SourceField, MirrorsStayMirrorsO4) {
  // Plain mirrors: what image paths do not carry, all specular, has the energy of the images left over.  Sum over all images of
  // 0.8^n / (4 pi r)^2 minus the direct sound, computed here by brute force over the lattice of images.
  AcousticConfig config = field_config(65'536, 0.5f);
  const Field field(rooms::shoe1(0.2, 0), config, rooms::shoe1_source());
  const glm::dvec3 size(5, 4, 3), source(1.2, 1.5, 1.1), listener(3.8, 2.3, 1.6);
  double exact = 0;
  const double longest = 343.0 * config.rir_length_s;
  const auto along = [](double place, double extent, int n) { return n % 2 == 0 ? n * extent + place : (n + 1) * extent - place; };
  for (int x = -70; x <= 70; ++x)
    for (int y = -88; y <= 88; ++y)
      for (int z = -116; z <= 116; ++z) {
        const int order = std::abs(x) + std::abs(y) + std::abs(z);
        const double r =
            glm::length(glm::dvec3(along(source.x, size.x, x), along(source.y, size.y, y), along(source.z, size.z, z)) - listener);
        if (order > 0 && r < longest) exact += std::pow(0.8, order) / std::pow(4 * std::numbers::pi * r, 2);
      }
  // A mirror room keeps hot and cold spots, which cells of half a metre average: 0.1 dB at this listener (measured at 0.25 m: 0.05 dB).
  EXPECT_NEAR(10 * std::log10(total_energy(field.at(rooms::shoe1_listener())) / exact), 0.0, 0.2);
}

TEST(SourceField, NothingLeaksThroughAClosedWall) {
  // Two rooms of one house, the door closed: a source in one, listeners along the wall in the other.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {3.3, 3, 2.5}, 0);
  rooms::append_box(mesh, {3.4, 0, 0}, {7, 3, 2.5}, 0);
  const auto room = rooms::scene_of(mesh, {Material::uniform("wall", 0.1f, 0.5f)});
  const Field field(room, field_config(2048, 1.f), rooms::point(1, 1, 1));
  for (double x = 3.42; x < 6.9; x += 0.31)
    for (double y = 0.02; y < 3; y += 0.37) EXPECT_EQ(total_energy(field.at(rooms::point(x, y, 1.3))), 0.0) << x << " " << y;
  EXPECT_GT(total_energy(field.at(rooms::point(3.2, 1, 1.3))), 0.0);
}

TEST(SourceField, WallsLetSoundThroughAsInTheTracer) {
  // Two rooms behind a sheet that lets 5 % through: the field in the far room against listener rays that pass walls, 8 seeds each.
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 3, 2.5}, 0);
  rooms::append_quad(mesh, {rooms::point(3.3, 0, 0), rooms::point(3.3, 3, 0), rooms::point(3.3, 3, 2.5), rooms::point(3.3, 0, 2.5)}, 1);
  Material sheet = Material::uniform("sheet", 0.2f, 1.f);
  sheet.transmission = CoefficientCurve::constant(0.05f);
  const auto room = rooms::scene_of(mesh, {Material::uniform("wall", 0.2f, 1.f), sheet});
  AcousticConfig config = field_config(8192, 0.5f);
  config.transmission = Switch::on;
  config.diffuse_last_segment = true;  // Lambert walls: no difference, and the last segments reach the source through the sheet
  config.rays = 4096;
  const glm::vec3 source = rooms::point(1, 1, 1), listener = rooms::point(5, 2, 1.4);
  const rooms::Sample field =
      rooms::over_seeds(8, config, [&](const AcousticConfig& c) { return total_energy(Field(room, c, source).at(listener)); });
  const rooms::Sample traced =
      rooms::over_seeds(8, config, [&](const AcousticConfig& c) { return total_energy(rooms::late_field(room, c, source, listener)); });
  EXPECT_GT(traced.mean, 0);
  EXPECT_NEAR(field.mean / traced.mean, 1.0,
              0.02 + 3.5 * std::hypot(field.standard_error / field.mean, traced.standard_error / traced.mean));
}

// Nothing reflects: behind a sheet that lets half of it through, all sound is that of the straight path, which is an arrival of its own.
TEST(SourceField, WhatGoesStraightThroughAWallIsNoLateSound) {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 3, 2.5}, 0);
  rooms::append_quad(mesh, {rooms::point(3.3, 0, 0), rooms::point(3.3, 3, 0), rooms::point(3.3, 3, 2.5), rooms::point(3.3, 0, 2.5)}, 1);
  const auto room = rooms::scene_of(mesh, {Material::uniform("wall", 1.f, 1.f), Material::uniform("sheet", 1.f, 0.f, 0.5f)});
  AcousticConfig config = field_config(8192, 0.5f);
  config.transmission = Switch::on;
  const glm::vec3 source = rooms::point(1, 1, 1), listener = rooms::point(5, 2, 1.4);
  const Field field(room, config, source);
  for (const glm::vec3 place : {listener, rooms::point(3.6, 1, 1), rooms::point(2, 1.5, 1)}) EXPECT_EQ(total_energy(field.at(place)), 0);
  EnergyResponse response;
  compute_energy_response(field.scene, field.candidates, field.field.get(), listener, response);
  double energy = total_energy(response.late);
  for (const Arrival& arrival : response.arrivals) energy += std::pow(double{arrival.amplitude[0]}, 2);
  EXPECT_NEAR(energy / (0.5 / std::pow(4 * std::numbers::pi * double{glm::length(listener - source)}, 2)), 1, 1e-4);
}

TEST(SourceField, DirectionsPointToWhereSoundComesFrom) {
  // Only the far wall reflects: all late sound comes from there.
  std::array<Material, 6> walls = rooms::uniform_walls(1, 1);
  walls[1] = Material::uniform("lit", 0.f, 1.f);  // x = 5
  AcousticConfig config = field_config(16'384, 0.5f);
  config.sh_order = 1;
  const Field field(rooms::box(5, 4, 3, walls), config, rooms::shoe1_source());
  const EnergyHistogram late = field.at(rooms::point(2.5, 2, 1.5));
  double energy = 0, toward_x = 0;
  std::array<float, 4> sh{};
  spherical_harmonics_n3d(rooms::point(1, 0, 0), 1, sh);
  for (int bin = 0; bin < late.num_bins(); ++bin) {
    const auto cell = late.at(bin, 0);
    energy += cell[0];
    for (int k = 1; k < 4; ++k) toward_x += cell[k] * sh[k] / 3;  // N3D: the mean direction is a third of the product
  }
  // A wall of 4 x 3 m seen from 2.5 m: the energy-weighted mean of its directions is about 0.85 of a unit vector.
  EXPECT_GT(toward_x / energy, 0.75);
  EXPECT_LT(toward_x / energy, 0.95);
}

TEST(SourceField, StopsAtItsErrorTargetAndTheTargetIsHonest) {
  // The estimate from the batches of one field against the spread over fields of other seeds, T20 at one listener.
  AcousticConfig config = field_config(2048, 1.f);
  const auto room = rooms::shoe1(0.2, 1);
  double estimate = 0;
  const rooms::Sample spread = rooms::over_seeds(24, config, [&](const AcousticConfig& c) {
    const Field field(room, c, rooms::shoe1_source());
    estimate += field.field->t20_error() / 24;
    EnergyResponse response;
    compute_energy_response(field.scene, field.candidates, field.field.get(), rooms::shoe1_listener(), response);
    return *measure_band(response.late.band_energy(0), response.late.bin_s(), 0).t20_s;
  });
  const double deviation = spread.standard_error * std::sqrt(24.0) / spread.mean;
  // A deviation from 24 values is known to 15 %; the estimate is a mean over probes all over the room, this one listener.
  EXPECT_GT(estimate, 0.6 * deviation);
  EXPECT_LT(estimate, 1.7 * deviation);

  config.field_error = static_cast<float>(0.5 * estimate);
  config.field_photons = 1 << 20;
  const Field better(room, config, rooms::shoe1_source());
  EXPECT_LE(better.field->t20_error(), double{config.field_error});
  EXPECT_GT(better.field->photons(), 2048u);
  EXPECT_LT(better.field->photons(), 16u * 2048u);
}

TEST(SourceField, PatternOfTheSourceIsFollowed) {
  // A source that radiates the same everywhere but with gain 1 and one that is omnidirectional are the same source.
  const auto room = rooms::shoe1(0.2, 1);
  const AcousticConfig config = field_config(4096, 1.f);
  SoundSource cardioid(rooms::shoe1_source());
  cardioid.directivity = Directivity::first_order(0.5f);
  const Field omni(room, config, rooms::shoe1_source()), directed(room, config, cardioid);
  // Power of a cardioid with unit gain in front: 1/3 of an omnidirectional one; late energy in a Lambert box follows the power, but for the
  // first bounces (5 %).
  EXPECT_NEAR(total_energy(directed.at(rooms::shoe1_listener())) / total_energy(omni.at(rooms::shoe1_listener())), 1.0 / 3, 0.04);
}

TEST(SourceField, DamagedAndForeignImagesAreRefused) {
  const Field field(rooms::shoe1(0.2, 0.5), field_config(2048, 1.f), rooms::shoe1_source());
  const auto image = field.field->image();
  const std::vector<std::byte> good(image.begin(), image.end());
  const auto open = [&](std::span<const std::byte> bytes) { SourceField(field.scene, field.candidates, bytes, nullptr); };
  EXPECT_NO_THROW(open(good));
  for (const std::size_t size : {std::size_t{0}, std::size_t{16}, std::size_t{100}, good.size() / 2, good.size() - 1})
    EXPECT_THROW(open(std::span(good).first(size)), InputError) << size;
  // Every byte of the header that decides a length, a place or an identity.
  for (std::size_t at = 0; at < 60; ++at) {
    if (at >= 24 && at < 32) continue;  // the number of photons is a report
    std::vector<std::byte> bad = good;
    bad[at] ^= std::byte{0x41};
    EXPECT_THROW(open(bad), InputError) << at;
  }
  std::vector<std::byte> bad = good;  // the place of a history, far outside
  std::memset(bad.data() + sizeof(FieldHeader) + 8, 0x7F, 8);
  EXPECT_THROW(open(bad), InputError);
  // Lengths that would be read past the end, each with a place that is right.
  for (const std::uint32_t count : {0x7FFFFFFFu, 0xFFFFFFFFu, 10000u}) {
    bad = good;
    std::memcpy(bad.data() + sizeof(FieldHeader) + 4, &count, 4);
    EXPECT_THROW(open(bad), InputError) << count;
  }
  // The last history, one bin longer than it is: the bins there are, the values are not.
  bad = good;
  std::size_t last = 0;
  std::uint64_t furthest = 0;
  for (std::size_t i = 0; i < field.scene.field_grid().size(); ++i) {
    FieldEntry entry;
    std::memcpy(&entry, good.data() + sizeof(FieldHeader) + i * sizeof entry, sizeof entry);
    if (entry.count > 0 && entry.offset >= furthest) {
      furthest = entry.offset;
      last = i;
    }
  }
  FieldEntry entry;
  std::memcpy(&entry, good.data() + sizeof(FieldHeader) + last * sizeof entry, sizeof entry);
  entry.first = 0;
  ++entry.count;
  std::memcpy(bad.data() + sizeof(FieldHeader) + last * sizeof entry, &entry, sizeof entry);
  EXPECT_THROW(open(bad), InputError);
  const Field elsewhere(rooms::shoe1(0.2, 0.5), field_config(2048, 1.f), rooms::shoe1_listener());
  EXPECT_THROW(SourceField(elsewhere.scene, elsewhere.candidates, good, nullptr), InputError);
}

TEST(SourceField, KeyTellsApartWhatDecidesBits) {
  const auto room = rooms::shoe1(0.2, 0.5);
  const AcousticConfig config = field_config(2048, 1.f);
  const auto key = [&](const AcousticConfig& c, const SoundSource& source) {
    const AcousticScene scene(room, c);
    return source_field_key(scene, EarlyCandidates(scene, source));
  };
  const std::uint64_t base = key(config, rooms::shoe1_source());
  EXPECT_EQ(base, key(config, rooms::shoe1_source()));
  EXPECT_NE(base, key(config, rooms::shoe1_source() + glm::vec3(1e-4f, 0, 0)));
  const auto changed = [&](auto&& change) {
    AcousticConfig other = config;
    change(other);
    return key(other, rooms::shoe1_source());
  };
  EXPECT_NE(base, changed([](AcousticConfig& c) { c.seed = 1; }));
  EXPECT_NE(base, changed([](AcousticConfig& c) { c.field_cell_m = 0.9f; }));
  EXPECT_NE(base, changed([](AcousticConfig& c) { c.early = Switch::automatic; }));
  EXPECT_NE(base, changed([](AcousticConfig& c) { c.scattering = 0.7f; }));
  EXPECT_NE(base, changed([](AcousticConfig& c) { c.rir_length_s = 0.9f; }));
  EXPECT_NE(base, changed([](AcousticConfig& c) { c.air_absorption = Switch::automatic; }));
  EXPECT_EQ(base, changed([](AcousticConfig& c) { c.threads = 2; }));
  EXPECT_EQ(base, changed([](AcousticConfig& c) { c.rays = 7; }));
  SoundSource large(rooms::shoe1_source());
  large.radius_m = 0.1f;
  EXPECT_NE(base, key(config, large));
  SoundSource cardioid(rooms::shoe1_source()), dipole(rooms::shoe1_source()), turned(rooms::shoe1_source());
  cardioid.directivity = turned.directivity = Directivity::first_order(0.5f);
  dipole.directivity = Directivity::first_order(0.f);
  turned.orientation = glm::quat(0, 0, 1, 0);
  EXPECT_NE(base, key(config, cardioid));
  EXPECT_NE(key(config, cardioid), key(config, dipole));
  EXPECT_NE(key(config, cardioid), key(config, turned));
  EXPECT_EQ(key(config, cardioid), key(config, SoundSource(cardioid)));
}

TEST(SourceField, KeyKnowsWhichFlutterTheFieldLeavesOut) {
  // Hard end walls, soft sides: with 512 rays and more the flutter goes over more side planes, and photons leave those chains out.
  std::array<Material, 6> walls = rooms::uniform_walls(0.9, 0);
  for (std::size_t i = 0; i < 2; ++i) walls[i] = rooms::uniform_walls(0.02, 0)[0];
  const auto room = rooms::box(6, 5, 3, walls);
  AcousticConfig config = field_config(2048, 1.f);
  config.early = Switch::on;
  config.early_order = 3;
  const auto key = [&](int rays) {
    config.rays = rays;
    const AcousticScene scene(room, config);
    const EarlyCandidates candidates(scene, rooms::point(1.7, 2.0, 1.4));
    EXPECT_NE(candidates.long_chains(), nullptr);
    return source_field_key(scene, candidates);
  };
  EXPECT_EQ(key(64), key(511));
  EXPECT_EQ(key(512), key(4096));
  EXPECT_NE(key(64), key(512));
}

}  // namespace
}  // namespace earshot
