// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <random>

#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/effect_scenes.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/rooms.h"

/// Estimators of the sound behind a wall against paths from both ends, which part nothing at walls.
namespace earshot {
namespace {

using rooms::point;
using rooms::Sample;

AcousticConfig behind_wall_config() {
  AcousticConfig config = rooms::plain_config();
  config.transmission = Switch::automatic;
  config.rir_length_s = 1.f;
  return config;
}

Sample bidirectional(const std::shared_ptr<const Scene>& rooms, glm::vec3 source, glm::vec3 listener) {
  AcousticConfig config = behind_wall_config();
  config.rays = config.source_rays = 8192;
  config.source_bounces = 60;
  config.diffuse_last_segment = false;
  return rooms::over_seeds(
      6, config, [&](const AcousticConfig& seeded) { return rooms::total_energy(effects::render(rooms, seeded, source, listener).late); });
}

/// Within three errors and the blur, and within 0.8 dB whatever the errors are.
void expect_same(const char* what, double tau, const Sample& found, const Sample& expected, double blur) {
  const double error = std::hypot(found.standard_error, expected.standard_error);
  std::printf("%s, tau %.3f: %.4g +- %.2g, from both ends %.4g +- %.2g\n", what, tau, found.mean, found.standard_error, expected.mean,
              expected.standard_error);
  EXPECT_NEAR(found.mean, expected.mean, 3 * error + blur * expected.mean) << what << tau;
  EXPECT_LT(std::abs(10 * std::log10(found.mean / expected.mean)), 0.8) << what << tau;
  EXPECT_LT(error, 0.15 * expected.mean) << what << tau;  // a factor of 2 would show
}

TEST(BehindWallSlow, PhotonsAndListenerRaysAgreeWithPathsFromBothEnds) {
  std::mt19937 draw(2);
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(draw); };
  for (int i = 0; i < 10; ++i) {
    const double tau = i == 0 ? 0.05 : std::exp(uniform(std::log(0.01), std::log(0.1))), absorption = uniform(0.15, 0.35);
    const auto rooms = effects::two_rooms(uniform(7, 11), uniform(3, 5), 3, 0, effects::material(absorption, 1),
                                          effects::material(std::max(absorption, tau), 1, tau));
    const glm::vec3 source = point(uniform(1, 2.5), uniform(0.8, 2.4), 1.4), listener = point(uniform(5.8, 6.6), uniform(0.8, 2.4), 1.6);
    const Sample expected = bidirectional(rooms, source, listener);
    const Sample field = rooms::over_seeds(8, behind_wall_config(), [&](AcousticConfig config) {
      config.field = Switch::on;
      const AcousticScene scene(rooms, config);
      const EarlyCandidates candidates(scene, source);
      EnergyHistogram late = make_histogram(scene);
      build_source_field(scene, candidates)->gather(scene, listener, late);
      return rooms::total_energy(late);
    });
    expect_same("field", tau, field, expected, 0.05);  // 0.2 dB: the blur of a cell of 1 m
    constexpr int seeds = 40;
    const Sample rays = rooms::over_seeds(seeds, behind_wall_config(), [&](AcousticConfig config) {
      config.rays = 64;
      config.diffuse_last_segment = true;  // exact where all is scattered
      return rooms::total_energy(rooms::late_field(rooms, config, source, listener));
    });
    expect_same("64 rays", tau, rays, expected, 0.01);
    // Of one response.  Rays that go through walls by chance scatter by 1 to 2.6 dB.
    const double scatter_db = 10 / std::log(10.0) * rays.standard_error * std::sqrt(double{seeds}) / rays.mean;
    std::printf("  scatter of 64 rays %.2f dB\n", scatter_db);
    EXPECT_LT(scatter_db, 1.6) << tau;
  }
}

}  // namespace
}  // namespace earshot
