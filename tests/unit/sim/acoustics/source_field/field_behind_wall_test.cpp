// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/effect_scenes.h"
#include "tests/support/acoustics/rooms.h"

/// Rooms that sound reaches through a wall alone.
namespace earshot {
namespace {

using rooms::point;

/// Energies of the late field at `listener` over seeds, with the photons of `fast`.
std::vector<double> field_energies(const std::shared_ptr<const Scene>& rooms, glm::vec3 source, glm::vec3 listener, int seeds) {
  std::vector<double> energies;
  for (int seed = 1; seed <= seeds; ++seed) {
    AcousticConfig config = rooms::plain_config();
    config.seed = static_cast<std::uint64_t>(seed);
    config.transmission = Switch::automatic;
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

}  // namespace
}  // namespace earshot
