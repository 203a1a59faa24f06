// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "sim/scene/scene_report.h"
#include "tests/support/acoustics/decay.h"
#include "tests/support/acoustics/late_field.h"
#include "tests/support/acoustics/shoe2.h"

// docs/evidence/oracles.md, O-14: estimates by formula against the exact decay of Lambert rooms.
namespace earshot {
namespace {

TEST(OracleO14, SabineConstantOfTheSpeedOfSound) {
  // 24 ln 10 / c.  Volume and area are the report's own, so only the constant and the formula are in question.
  for (const auto& [speed, constant] : {std::pair{343.0, 0.161113826}, {343.2, 0.161019937}, {340.0, 0.162535418}}) {
    Air air;
    air.speed_of_sound_m_per_s = static_cast<float>(speed);
    const SceneReport report = report_scene(*rooms::box(5, 4, 3, rooms::uniform_walls(0.2, 1), 1, air));
    EXPECT_NEAR(report.rt60_estimate_s[0] * report.area_m2 * -std::log(0.8) / report.volume_m3, constant, 2e-6 * constant);
  }
}

TEST(OracleO14, EyringEstimateOfTheSceneReport) {
  // Mean free path and mean absorption come from 4096 walks of 32 paths: 0.3 % each, three of them.
  for (const auto& [absorption, eyring_s] : {std::pair{0.05, 2.0049}, {0.1, 0.97606}, {0.2, 0.46086}, {0.5, 0.14836}}) {
    EXPECT_NEAR(report_scene(*rooms::shoe1(absorption, 1)).rt60_estimate_s[3], eyring_s, 0.01 * eyring_s) << absorption;
  }
  const SceneReport report = report_scene(*shoe2::room(1));
  for (int band = 0; band < shoe2::kBands; ++band) {
    EXPECT_NEAR(report.rt60_estimate_s[band], shoe2::kEyringS[band], 0.015 * shoe2::kEyringS[band]) << band;
  }
}

TEST(OracleO14, LambertDecayPerBandIsNotEyring) {
  // Octaves with their own absorption on every wall.  Asymptotic decay: fitted below -15 dB.  Eyring is 1.2 to 8 % short.
  AcousticConfig config = rooms::plain_config();
  config.bands = 0;
  config.rays = 16384;
  config.rir_length_s = 0.45f;
  config.time_bin_s = 0.001f;
  std::vector<double> t60_s[shoe2::kBands], energy[shoe2::kBands];
  for (int seed = 1; seed <= 16; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    const EnergyHistogram h = rooms::late_field(shoe2::room(1), config, shoe2::source(), shoe2::listener());
    for (int band = 0; band < shoe2::kBands; ++band) {
      const std::vector<double> series = h.band_energy(band);
      t60_s[band].push_back(decay::time_s(series, 1e-3, -15, -40));
      energy[band].push_back(decay::curve(series)[0]);
    }
  }
  for (int band = 0; band < shoe2::kBands; ++band) {
    const decay::Estimate t60 = decay::estimate(t60_s[band]), level = decay::estimate(energy[band]);
    std::printf("SHOE-2 band %d T60 radiosity %.4f, traced %.4f +- %.4f; energy %.6f, traced %.6f +- %.6f\n", band, shoe2::kLambertS[band],
                t60.mean, t60.standard_error, shoe2::kLambertEnergy[band], level.mean, level.standard_error);
    EXPECT_NEAR(t60.mean, shoe2::kLambertS[band], 3.5 * t60.standard_error + 0.002 * shoe2::kLambertS[band]) << band;
    EXPECT_LT(t60.standard_error, 0.004 * shoe2::kLambertS[band]) << band;
    EXPECT_GT(t60.mean, 1.01 * shoe2::kEyringS[band]) << band;
    EXPECT_NEAR(level.mean, shoe2::kLambertEnergy[band], 3.5 * level.standard_error + 5e-4 * shoe2::kLambertEnergy[band]) << band;
    EXPECT_LT(level.standard_error, 0.004 * shoe2::kLambertEnergy[band]) << band;
  }
}

}  // namespace
}  // namespace earshot
