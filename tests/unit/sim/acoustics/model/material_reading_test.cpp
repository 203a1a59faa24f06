// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "tests/support/acoustics/late_field.h"

/// docs/evidence/oracles.md, O-15: what "0.1" in a material file means.
namespace earshot {
namespace {

/// Decay time by a line through -5 to -25 dB of the energy decay curve.
double decay_time_s(const EnergyHistogram& h) {
  const std::vector<double> energy = h.band_energy(0);
  std::vector<double> edc(energy.size());
  energy_decay_curve(energy, edc);
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0; i < edc.size(); ++i) {
    const double level_db = 10 * std::log10(edc[i] / edc[0]), t = static_cast<double>(i) * h.bin_s();
    if (level_db > -5 || level_db < -25) continue;
    n += 1, x += t, y += level_db, xx += t * t, xy += t * level_db;
  }
  return -60 * (n * xx - x * x) / (n * xy - x * y);
}

double decay_in_shoe1_s(const MaterialImport& import) {
  const std::string json = R"({"materials": [{"name": "plaster", "absorption": [125, 0.1, 4000, 0.1], "scattering": [125, 1, 4000, 1]}]})";
  const Material plaster = MaterialDatabase::from_json(json, "m.json", import).all()[0];
  std::array<Material, 6> walls;
  walls.fill(plaster);
  AcousticConfig config = rooms::plain_config();
  config.rays = 2000;
  config.rir_length_s = 0.8f;
  config.time_bin_s = 0.002f;
  return decay_time_s(rooms::late_field(rooms::box(5, 4, 3, walls), config, rooms::shoe1_source(), rooms::shoe1_listener()));
}

TEST(O15_CoefficientReading, TablesHoldEnergyCoefficients) {
  // 2000 rays scatter by 0.5 %; the curve is cut at 0.8 s, -48 dB, which shortens the fit by 0.1 %.
  EXPECT_NEAR(decay_in_shoe1_s({}), 0.9976, 0.02 * 0.9976);
  // Read as pressure alpha is 0.19.  Eyring gives 0.4880 s; Lambert walls decay 5 % slower (0.48135 s at 0.20, 0.9976 s at 0.10: 0.511 s).
  EXPECT_NEAR(decay_in_shoe1_s({.reading = CoefficientReading::pressure}), 0.511, 0.03 * 0.511);
}

}  // namespace
}  // namespace earshot
