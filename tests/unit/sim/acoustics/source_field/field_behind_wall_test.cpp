// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "sim/acoustics/source_field/photon_pass.h"
#include "sim/acoustics/source_field/source_field.h"
#include "sim/scene/mesh/triangle_mesh.h"
#include "tests/support/acoustics/effect_scenes.h"
#include "tests/support/acoustics/rooms.h"

/// Rooms that sound reaches through a wall alone.
namespace earshot {
namespace {

using rooms::point;

/// Energies of the late field at `listener` over seeds, with the photons of `fast`.
std::vector<double> field_energies(const std::shared_ptr<const Scene>& rooms, glm::vec3 source, glm::vec3 listener, int seeds,
                                   Switch transmission = Switch::automatic) {
  std::vector<double> energies;
  for (int seed = 1; seed <= seeds; ++seed) {
    AcousticConfig config = rooms::plain_config();
    config.seed = static_cast<std::uint64_t>(seed);
    config.transmission = transmission;
    config.field = Switch::on;
    config.rir_length_s = 1.f;
    const AcousticScene scene(rooms, config);
    const EarlyCandidates candidates(scene, source);
    EnergyHistogram late = make_histogram(scene);
    build_source_field(scene, candidates)->gather(scene, listener, late);
    energies.push_back(rooms::total_energy(late));
  }
  return energies;
}

struct Level {
  double mean = 0, error = 0, scatter_db = 0;
  explicit Level(const std::vector<double>& energies) {
    const auto n = static_cast<double>(energies.size());
    double squares = 0, db = 0, db_squares = 0;
    for (const double energy : energies) mean += energy / n;
    for (const double energy : energies) {
      const double level = 10 * std::log10(energy / mean);
      squares += (energy - mean) * (energy - mean), db += level / n, db_squares += level * level / n;
    }
    error = std::sqrt(squares / (n - 1) / n);
    scatter_db = std::sqrt(std::max(db_squares - db * db, 0.0) * n / (n - 1));
  }
};

// Behind one wall all energy is in proportion to its transmittance, but for what goes through three times: a fraction tau^2.  At 0.05 one
// photon in twenty goes through by chance, at 0.0005 one in two thousand: by chance two seeds in twelve had none behind the wall.
TEST(FieldBehindWall, LevelsAreThoseOfTheTransmittanceInEverySeed) {
  const std::vector<double> loud = field_energies(effects::two_rooms_scene(0, 0.05).scene, point(1.5, 1.2, 1.5), point(7, 2.6, 1.3), 12);
  const Level reference(loud);
  std::mt19937 draw(1);
  std::uniform_real_distribution<double> exponent(std::log(1e-4), std::log(0.02));
  for (int i = 0; i < 10; ++i) {
    const double tau = i == 0 ? 0.0005 : std::exp(exponent(draw));
    const std::vector<double> energies =
        field_energies(effects::two_rooms_scene(0, tau).scene, point(1.5, 1.2, 1.5), point(7, 2.6, 1.3), i == 0 ? 12 : 6);
    EXPECT_GT(*std::min_element(energies.begin(), energies.end()), 0) << tau;
    const Level level(energies);
    const double ratio = level.mean / tau * 0.05 / reference.mean;
    const double error = std::hypot(level.error / level.mean, reference.error / reference.mean);
    std::printf("tau %.2g: level over transmittance %.3f +- %.3f, scatter %.2f dB\n", tau, ratio, error, level.scatter_db);
    // Three standard errors; 2 % for what goes through three times at 0.05.
    EXPECT_NEAR(ratio, 1, 3 * error + 0.02) << tau;
    // 512 photons and more, of which a room has hundreds: 1 dB is three times what 200 independent ones scatter.
    EXPECT_LT(level.scatter_db, 1) << tau;
    EXPECT_LT(error, 0.15) << tau;  // a factor of 2 would show
  }
}

/// A room of 6 x 5 x 3 m with a closed cabinet in it, and where it stands.
struct Furnished {
  std::shared_ptr<const Scene> scene;
  glm::vec3 in_cabinet{0};
};

/// Draws the cabinet, of 1.2 m3 or more.
Furnished furnished_room(std::mt19937& draw, double tau) {
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(draw); };
  const glm::dvec3 size(uniform(1.1, 1.6), uniform(1.5, 2.2), uniform(0.8, 1.2)), lower(uniform(3, 4.2), 0.1, -uniform(2, 4.8));
  TriangleMesh mesh;
  rooms::append_box(mesh, {0, 0, 0}, {6, 5, 3}, 0);
  append_box(mesh, glm::vec3(lower), glm::vec3(lower + size), 1, 0);
  return {rooms::scene_of(std::move(mesh), {effects::material(0.2, 1), effects::material(0.1, 1, tau)}), glm::vec3(lower + 0.5 * size)};
}

AcousticConfig behind_walls(Switch transmission) {
  AcousticConfig config = rooms::plain_config();
  config.transmission = transmission;
  config.field = Switch::on;
  config.rir_length_s = 1.f;
  return config;
}

// By chance one photon in twenty goes through a wall of the cabinet; the bounces of those inside are more than theirs outside.  With as
// many photons inside as a room behind a wall gets there were 3 to 8 times as many segments in the houses of the benchmarks.
TEST(FieldBehindWall, ACabinetTakesNoPhotonsFromTheRoom) {
  std::mt19937 draw(3);
  for (int i = 0; i < 10; ++i) {
    const Furnished room = furnished_room(draw, std::uniform_real_distribution<double>(0.0005, 0.05)(draw));
    std::array<double, 2> segments{};
    for (const bool through : {false, true}) {
      const AcousticScene scene(room.scene, behind_walls(through ? Switch::on : Switch::off));
      const EarlyCandidates candidates(scene, point(1, 1, 1.5));
      const FieldGrid grid(*room.scene, 1.f);
      PhotonTracks tracks;
      TraceStats stats;
      for (std::uint32_t chunk = 0; chunk < 4; ++chunk) {
        trace_photons(scene, candidates, grid, chunk, tracks, stats);
        segments[through] += static_cast<double>(tracks.segments.size());
      }
    }
    EXPECT_LT(segments[1], 1.3 * segments[0]) << i;
    EXPECT_GT(segments[1], 0.8 * segments[0]) << i;
  }
}

TEST(FieldBehindWall, CabinetsTakeNoPhotonsFromTheRoomsBehindAWall) {
  std::mt19937 draw(5);
  for (int i = 0; i < 10; ++i) {
    const double x_m = std::uniform_real_distribution<double>(3, 5)(draw);
    std::array<double, 2> segments{};
    for (const bool through : {false, true}) {
      TriangleMesh mesh;
      rooms::append_box(mesh, {0, 0, 0}, {8, 5, 3}, 0);
      rooms::append_quad(mesh, {point(x_m, 0, 0), point(x_m, 5, 0), point(x_m, 5, 3), point(x_m, 0, 3)}, 1);
      for (int cabinet = 0; cabinet < 3; ++cabinet) {
        const glm::vec3 lower = point(cabinet == 2 ? 6.2 : 1.2, 1.3 + 1.7 * (cabinet % 2), 0.1);
        append_box(mesh, lower, lower + glm::vec3(1.2f, 2, 0.9f), 2, 0);
      }
      const auto rooms = rooms::scene_of(
          std::move(mesh), {effects::material(0.2, 1), effects::material(0.1, 1, 0.01), effects::material(0.1, 1, through ? 0.01 : 0)});
      const AcousticScene scene(rooms, behind_walls(Switch::on));
      const EarlyCandidates candidates(scene, point(0.6, 0.6, 1.5));
      const FieldGrid grid(*rooms, 1.f);
      EXPECT_EQ(grid.num_rooms(), 5u);
      PhotonTracks tracks;
      TraceStats stats;
      for (std::uint32_t chunk = 0; chunk < 4; ++chunk) {
        trace_photons(scene, candidates, grid, chunk, tracks, stats);
        segments[through] += static_cast<double>(tracks.segments.size());
      }
    }
    std::printf("segments of photons: %.0f, into cabinets too %.0f\n", segments[0], segments[1]);
    EXPECT_LT(segments[1], 1.3 * segments[0]) << i;
    EXPECT_GT(segments[1], 0.8 * segments[0]) << i;
  }
}

// Up to 0.6 m of thickness a transmittance is that of the whole wall, and its inside no room.  Above, each face has it, and the inside is a
// room on the way.
TEST(FieldBehindWall, LevelsBehindAWallOfTwoFacesAreThoseOfItsTransmittance) {
  std::mt19937 draw(6);
  for (int i = 0; i < 4; ++i) {
    const bool thick = i >= 2;
    const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(draw); };
    const double x_m = uniform(3, 5), thickness_m = thick ? uniform(0.65, 0.9) : uniform(0.3, 0.55);
    const double tau = std::exp(uniform(std::log(1e-3), std::log(1e-2)));
    const auto level = [&](double transmittance) {
      TriangleMesh mesh;
      rooms::append_box(mesh, {0, 0, 0}, {8, 5, 3}, 0);
      append_box(mesh, point(x_m, 5.01, -0.01), point(x_m + thickness_m, -0.01, 3.01), 1, 0);
      const auto rooms = rooms::scene_of(std::move(mesh), {effects::material(0.2, 1), effects::material(0.2, 1, transmittance)});
      const FieldGrid grid(*rooms, 1.f);
      int bodies = 0;
      for (std::uint32_t room = 0; room < grid.num_rooms(); ++room) bodies += grid.inside_body(room) ? 1 : 0;
      EXPECT_GE(grid.num_rooms(), thick ? 3u : 2u);
      EXPECT_EQ(bodies, 0) << thickness_m;  // it lies between two rooms
      return Level(field_energies(rooms, point(1.5, 1.2, 1.5), point(x_m + thickness_m + 1, 2.6, 1.3), 6));
    };
    const Level loud = level(0.03), soft = level(tau);
    const double ratio = soft.mean / loud.mean * std::pow(0.03 / tau, thick ? 2 : 1);
    const double error = std::hypot(soft.error / soft.mean, loud.error / loud.mean);
    std::printf("two faces of tau %.2g, %.2f m: level over transmittance %.3f +- %.3f, scatter %.2f dB\n", tau, thickness_m, ratio, error,
                soft.scatter_db);
    // Three standard errors; a tenth for what goes through more often.
    EXPECT_NEAR(ratio, 1, 3 * error + 0.1) << tau;
    EXPECT_LT(error, 0.15) << tau;
  }
}

// The effect plan knows air in rooms alone, so that the late sound has to be asked for.
TEST(FieldBehindWall, ASourceOutsideIsHeardInProportionToTheTransmittance) {
  std::mt19937 draw(7);
  for (int i = 0; i < 3; ++i) {
    const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(draw); };
    const glm::vec3 source = point(-uniform(0.5, 2), uniform(1, 4), uniform(0.5, 2.5)), listener = point(uniform(2, 5), 2, 1.5);
    const double tau = i == 0 ? 0.0005 : std::exp(uniform(std::log(2e-4), std::log(0.01)));
    const auto level = [&](double transmittance) {
      TriangleMesh mesh;
      rooms::append_box(mesh, {0, 0, 0}, {6, 5, 3}, 0);
      const auto room = rooms::scene_of(std::move(mesh), {effects::material(0.2, 1, transmittance)});
      return Level(field_energies(room, source, listener, 8, Switch::on));
    };
    const Level loud = level(0.02), soft = level(tau);
    const double ratio = soft.mean / tau * 0.02 / loud.mean, error = std::hypot(soft.error / soft.mean, loud.error / loud.mean);
    std::printf("from outside, tau %.2g: level over transmittance %.3f +- %.3f, scatter %.2f dB\n", tau, ratio, error, soft.scatter_db);
    EXPECT_NEAR(ratio, 1, 3 * error + 0.1) << tau;
    EXPECT_LT(error, 0.15) << tau;
  }
}

TEST(FieldBehindWall, ASourceInACabinetIsHeardInProportionToItsTransmittance) {
  std::mt19937 draw(4);
  const auto energies = [](const Furnished& room) { return field_energies(room.scene, room.in_cabinet, point(1.2, 1.4, 1.5), 6); };
  for (int i = 0; i < 3; ++i) {
    std::mt19937 same = draw;
    const Level loud(energies(furnished_room(same, 0.02)));
    const double tau = i == 0 ? 0.0005 : std::exp(std::uniform_real_distribution<double>(std::log(2e-4), std::log(0.01))(same));
    const Level level(energies(furnished_room(draw, tau)));
    const double ratio = level.mean / tau * 0.02 / loud.mean, error = std::hypot(level.error / level.mean, loud.error / loud.mean);
    std::printf("cabinet, tau %.2g: level over transmittance %.3f +- %.3f, scatter %.2f dB\n", tau, ratio, error, level.scatter_db);
    // What goes through is a part of what the walls absorb.  Three standard errors; a tenth for what goes back in.
    EXPECT_NEAR(ratio, 1, 3 * error + 0.1) << tau;
    EXPECT_LT(error, 0.15) << tau;
  }
}

}  // namespace
}  // namespace earshot
