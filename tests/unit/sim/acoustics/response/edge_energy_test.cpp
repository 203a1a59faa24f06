// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/paths/line_of_sight.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/base/random.h"
#include "sim/scene/generators/house_generator.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

/// A box of 7.2 x 6 x 4 m whose wall at x = 0 is folded along z into strips of 0.6 m that stand at +-degrees.
TriangleMesh folded_room(double degrees) {
  TriangleMesh mesh;
  const glm::dvec3 size(6, 7.2, 4);
  rooms::append_box(mesh, {0, 0, 0}, size, 0);
  // Without the two triangles of the wall at x = 0, which come first.
  mesh.triangles.erase(mesh.triangles.begin(), mesh.triangles.begin() + 2);
  mesh.triangle_material.erase(mesh.triangle_material.begin(), mesh.triangle_material.begin() + 2);
  mesh.triangle_object.erase(mesh.triangle_object.begin(), mesh.triangle_object.begin() + 2);
  const double depth = 0.6 * std::tan(degrees * std::numbers::pi / 180);
  std::vector<glm::vec3> low, high;
  for (int i = 0; i <= 12; ++i) {
    low.push_back(rooms::point(i % 2 == 1 ? depth : 0.0, 0.6 * i, 0));
    high.push_back(rooms::point(i % 2 == 1 ? depth : 0.0, 0.6 * i, 4));
  }
  for (std::size_t i = 0; i < 12; ++i) rooms::append_quad(mesh, {low[i], low[i + 1], high[i + 1], high[i]}, 0);
  return mesh;
}

/// Six open reflectors of 3 x 2 m, tilted, below the ceiling of a hall of 30 x 20 x 15 m.
TriangleMesh hall_with_reflectors() {
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {30, 20, 15}, 0);
  for (int i = 0; i < 6; ++i) {
    const double x = 4 + 4.5 * (i / 2), y = i % 2 == 0 ? 6 : 12;
    rooms::append_quad(mesh,
                       {rooms::point(x, y, 9), rooms::point(x + 3, y, 9.8), rooms::point(x + 3, y + 2, 9.8), rooms::point(x, y + 2, 9)}, 0);
  }
  return mesh;
}

struct Gain {
  double mean_db = 0, worst_db = 0;
};

/// Strength in `scene` over that in `other`, per band.
std::vector<Gain> gains_over(const AcousticScene& other, const AcousticScene& scene, glm::vec3 source,
                             std::span<const glm::vec3> listeners) {
  const EarlyCandidates candidates(scene, source), other_candidates(other, source);
  std::vector<Gain> gain(static_cast<std::size_t>(scene.num_bands()));
  for (const glm::vec3 listener : listeners) {
    EnergyResponse a, b;
    compute_energy_response(scene, candidates, listener, a);
    compute_energy_response(other, other_candidates, listener, b);
    const RoomMetrics by_a = measure(scene, a), by_b = measure(other, b);
    for (std::size_t band = 0; band < gain.size(); ++band) {
      const double db = *by_a.bands[band].g_db - *by_b.bands[band].g_db;
      gain[band].mean_db += db / static_cast<double>(listeners.size());
      gain[band].worst_db = std::max(gain[band].worst_db, std::abs(db));
    }
  }
  return gain;
}

/// What diffraction adds, with common random numbers.
Gain gain_of(const std::shared_ptr<const Scene>& geometry, glm::vec3 source, std::span<const glm::vec3> listeners, std::size_t band) {
  AcousticConfig config;
  config.rays = 512;
  config.rir_length_s = 0.6f;
  config.diffraction = Switch::on;
  AcousticConfig off = config;
  off.diffraction = Switch::off;
  return gains_over(AcousticScene(geometry, off), AcousticScene(geometry, config), source, listeners)[band];
}

std::vector<glm::vec3> listeners_in(glm::dvec3 lower, glm::dvec3 upper, int count) {
  std::vector<glm::vec3> listeners;
  for (int i = 0; i < count; ++i) {
    const RandomStream random(3, Purpose::test, static_cast<std::uint32_t>(i));
    const glm::dvec3 u(random.uniform(0), random.uniform(1), random.uniform(2));
    const glm::dvec3 at = lower + u * (upper - lower);
    listeners.push_back(rooms::point(at.x, at.y, at.z));
  }
  return listeners;
}

TEST(EdgeEnergy, FoldedWallIsAFlatOne) {
  const auto geometry = rooms::scene_of(folded_room(3), {Material::uniform("wall", 0.1f, 0.1f)});
  const Gain gain = gain_of(geometry, rooms::point(4, 2.2, 1.5), listeners_in({0.5, 0.5, 0.5}, {5.5, 6.7, 3.5}, 24), 0);
  EXPECT_LT(std::abs(gain.mean_db), 0.1);
  EXPECT_LT(gain.worst_db, 0.1);
}

TEST(EdgeEnergy, EdgesOfADeeperFoldMoveEnergyAndAddNone) {
  // Strips at +-20 degrees: every other edge has 220 degrees of air and takes part in reflections.
  const auto geometry = rooms::scene_of(folded_room(20), {Material::uniform("wall", 0.1f, 0.1f)});
  for (const std::size_t band : {0u, 2u}) {
    const Gain gain = gain_of(geometry, rooms::point(4, 2.2, 1.5), listeners_in({0.8, 0.5, 0.5}, {5.5, 6.7, 3.5}, 24), band);
    std::printf("fold of 20 degrees, band %zu: mean %.4f, worst %.4f dB\n", band, gain.mean_db, gain.worst_db);
    EXPECT_GT(gain.worst_db, 0.001) << "no edge acts";
    EXPECT_LT(std::abs(gain.mean_db), 0.1);
    EXPECT_LT(gain.worst_db, 0.5);
  }
}

TEST(EdgeEnergy, FoldedWallHasTheLevelsOfAFlatOne) {
  // Another geometry, other rays: their noise is about 0.03 dB.
  AcousticConfig config;
  config.rays = 32'768;
  config.rir_length_s = 0.3f;
  config.diffraction = Switch::on;
  const std::vector<Material> walls = {Material::uniform("wall", 0.1f, 0.1f)};
  const AcousticScene folded(rooms::scene_of(folded_room(3), walls), config), flat(rooms::scene_of(folded_room(0), walls), config);
  const auto gain = gains_over(flat, folded, rooms::point(4, 2.2, 1.5), listeners_in({0.5, 0.5, 0.5}, {5.5, 6.7, 3.5}, 8));
  for (std::size_t band = 0; band < gain.size(); ++band) {
    std::printf("folded over flat, band %zu: mean %.4f, worst %.4f dB\n", band, gain[band].mean_db, gain[band].worst_db);
    EXPECT_LT(std::abs(gain[band].mean_db), 0.1) << band;
  }
  EXPECT_LT(gain[0].worst_db, 0.1);
  EXPECT_LT(gain[1].worst_db, 0.1);
}

TEST(EdgeEnergy, StripsOfAFlatWallAreOnePlane) {
  // The control: the same strips, coplanar, are the wall of a box.
  AcousticConfig config;
  config.late = Switch::off;
  config.diffraction = Switch::on;
  TriangleMesh box;
  rooms::append_box(box, {0, 0, 0}, {6, 7.2, 4}, 0);
  const std::vector<Material> walls = {Material::uniform("wall", 0.1f, 0.1f)};
  const AcousticScene strips(rooms::scene_of(folded_room(0), walls), config), whole(rooms::scene_of(std::move(box), walls), config);
  EXPECT_TRUE(strips.folds().planes.empty());
  const auto gain = gains_over(whole, strips, rooms::point(4, 2.2, 1.5), listeners_in({0.5, 0.5, 0.5}, {5.5, 6.7, 3.5}, 8));
  for (const Gain& band : gain) EXPECT_LT(band.worst_db, 1e-3);
}

TEST(EdgeEnergy, ImageInAFoldedWallMovesWithTheListener) {
  // Images in single strips come and go on the way; in the fold as a whole there is one, whose level moves as that of a flat wall's.
  AcousticConfig config;
  config.late = Switch::off;
  config.early_order = 1;
  const std::vector<Material> walls = {Material::uniform("wall", 0.1f, 0.1f)};
  const AcousticScene folded(rooms::scene_of(folded_room(3), walls), config), flat(rooms::scene_of(folded_room(0), walls), config);
  const glm::vec3 source = rooms::point(4, 2.2, 1.5);
  const EarlyCandidates by_fold(folded, source), by_plane(flat, source);
  for (int step = 0; step < 100; ++step) {
    const glm::vec3 listener = rooms::point(3, 0.5 + 0.06 * step, 1.7);
    std::array<double, 2> energy{};
    std::vector<Arrival> arrivals;
    for (const bool fold : {false, true}) {
      arrivals.clear();
      (fold ? by_fold : by_plane).find_arrivals(fold ? folded : flat, listener, arrivals);
      for (const Arrival& arrival : arrivals) energy[fold ? 1 : 0] += double{arrival.amplitude[0]} * arrival.amplitude[0];
    }
    // The mirror is 1.6 cm nearer than the flat one.
    EXPECT_NEAR(10 * std::log10(energy[1] / energy[0]), 0, 0.05) << step;
  }
}

TEST(EdgeEnergy, OpenReflectorsAddNothing) {
  const auto geometry = rooms::scene_of(hall_with_reflectors(), {Material::uniform("wall", 0.15f, 0.2f)});
  for (const std::size_t band : {0u, 1u, 3u}) {
    const Gain gain = gain_of(geometry, rooms::point(3, 10, 1.5), listeners_in({8, 2, 1}, {28, 18, 2}, 16), band);
    std::printf("reflectors, band %zu: mean %.4f, worst %.4f dB\n", band, gain.mean_db, gain.worst_db);
    // Twice what is seen; the audit saw 0.5 and 1.5 dB before waves were added with their phase.
    EXPECT_LT(std::abs(gain.mean_db), 0.015);
    EXPECT_LT(gain.worst_db, 0.1);
  }
}

TEST(EdgeEnergy, FewAndManyRaysAgreeInAFurnishedRoom) {
  // A furnished house: hundreds of edges of 0.25 m and more.  The late field is that of the same rays for both; what differs is which edges
  // count.  Listeners in sight of the source.
  HouseConfig house;
  house.seed = 4;
  house.rooms = 4;
  TriangleMesh mesh = generate_house(house);
  std::vector<Material> materials(mesh.material_names.size(), Material::uniform("wall", 0.15f, 0.3f));
  const auto geometry = std::make_shared<const Scene>("house", std::move(mesh), std::move(materials), rooms::oracle_air());
  AcousticConfig automatic;
  automatic.rays = 256;
  automatic.rir_length_s = 0.5f;
  AcousticConfig on = automatic;
  on.diffraction = Switch::on;
  const AcousticScene few(geometry, automatic), all(geometry, on);
  const glm::vec3 lower = geometry->bounds().lower, upper = geometry->bounds().upper;
  int in_sight = 0;
  double mean_db = 0, worst_db = 0;
  for (std::uint32_t i = 0; i < 4; ++i) {
    const auto place = [&](std::uint32_t j) {
      const RandomStream random(9, Purpose::test, i, j);
      return glm::vec3(lower.x + (upper.x - lower.x) * random.uniform(0), 1.4f, lower.z + (upper.z - lower.z) * random.uniform(1));
    };
    const glm::vec3 source = place(0);
    const EarlyCandidates by_few(few, source), by_all(all, source);
    for (std::uint32_t j = 1; j < 120; ++j) {
      const glm::vec3 listener = place(j);
      if (!in_line_of_sight(all, source, listener) || glm::length(listener - source) < 0.5f) continue;
      EnergyResponse a, b;
      compute_energy_response(few, by_few, listener, a);
      compute_energy_response(all, by_all, listener, b);
      const double db = *measure(few, a).drr_db - *measure(all, b).drr_db;
      mean_db += db;
      worst_db = std::max(worst_db, std::abs(db));
      ++in_sight;
    }
  }
  ASSERT_GT(in_sight, 20);
  std::printf("few and many rays: mean %.4f, worst %.4f dB\n", mean_db / in_sight, worst_db);
  EXPECT_LT(std::abs(mean_db / in_sight), 0.05);  // twice what is seen
  EXPECT_LT(worst_db, 1.0);
}

}  // namespace
}  // namespace earshot
