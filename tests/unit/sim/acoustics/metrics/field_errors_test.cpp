// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

#include "sim/acoustics/metrics/standard_errors.h"
#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/field_rooms.h"

/// Does a field know how wrong it is at the place of the listener?
namespace earshot {
namespace {

using field_rooms::Setting;

AcousticConfig field_config(float length_s) {
  AcousticConfig config = acoustic_preset("fast");
  config.field = Switch::on;
  config.air_absorption = config.wall_power = config.diffraction = Switch::off;
  config.bands = 1;
  config.sh_order = 0;
  config.rir_length_s = length_s;
  return config;
}

TEST(FieldErrors, SharesOfBatchesAreOneInTheMean) {
  for (std::uint32_t number = 0; number < 3; ++number) {
    const Setting setting = Setting::drawn(number);
    AcousticConfig config = field_config(0.3f);
    config.field_photons = 512;
    const AcousticScene scene(setting.scene, config);
    const EarlyCandidates candidates(scene, setting.source);
    const auto field = build_source_field(scene, candidates);
    const FieldBatches batches = field_batches(scene, candidates, *field, setting.listener);
    const std::size_t values = batches.share.size() / static_cast<std::size_t>(batches.count);
    ASSERT_EQ(batches.count, 8);
    bool differ = false;
    for (std::size_t i = 0; i < values; ++i) {
      double mean = 0;
      for (std::size_t batch = 0; batch < static_cast<std::size_t>(batches.count); ++batch) {
        mean += double{batches.share[batch * values + i]} / batches.count;
        differ = differ || batches.share[batch * values + i] != 1.f;
      }
      EXPECT_NEAR(mean, 1.0, 1e-5);
    }
    EXPECT_TRUE(differ) << number;
  }
}

// Ten drawn corridors, rooms behind doors and boxes.  A stated error has Student's factor for seven degrees of freedom, 1.2, so that
// deviations from the mean over seeds are 0.84 stated errors; half of that or twice that fails.
TEST(FieldErrors, AreTheSpreadOverSeedsAtTheListener) {
  constexpr int kSettings = 10, kSeeds = 4;
  constexpr std::array<std::optional<double> BandMetrics::*, 3> kValues{&BandMetrics::t20_s, &BandMetrics::edt_s, &BandMetrics::g_db};
  std::array<double, kValues.size()> squares{}, degrees{};
  for (std::uint32_t number = 0; number < kSettings; ++number) {
    const Setting setting = Setting::drawn(number);
    std::array<std::vector<double>, kValues.size()> values, errors;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      AcousticConfig config = field_config(0.7f);
      config.field_photons = 512;
      config.seed = static_cast<std::uint64_t>(seed);
      const AcousticScene scene(setting.scene, config);
      const EarlyCandidates candidates(scene, setting.source);
      const auto field = build_source_field(scene, candidates);
      EnergyResponse response;
      compute_energy_response(scene, candidates, field.get(), setting.listener, response);
      const BandMetrics found = measure(scene, response).bands[0];
      const MetricErrors stated = standard_errors(scene, candidates, field.get(), setting.listener, response);
      for (std::size_t i = 0; i < kValues.size(); ++i) {
        const std::optional<double>&value = found.*kValues[i], &error = stated.bands.at(0).*kValues[i];
        if (!value || !error) continue;
        ASSERT_GT(*error, 0.0);
        values[i].push_back(*value);
        errors[i].push_back(*error);
      }
    }
    for (std::size_t i = 0; i < kValues.size(); ++i) {
      ASSERT_GE(values[i].size(), 3u) << number << " " << i;
      double mean = 0, error2 = 0;
      for (std::size_t seed = 0; seed < values[i].size(); ++seed) {
        mean += values[i][seed] / static_cast<double>(values[i].size());
        error2 += errors[i][seed] * errors[i][seed] / static_cast<double>(values[i].size());
      }
      for (const double value : values[i]) squares[i] += (value - mean) * (value - mean) / error2;
      degrees[i] += static_cast<double>(values[i].size()) - 1;
    }
  }
  for (std::size_t i = 0; i < kValues.size(); ++i) {
    const double deviation = std::sqrt(squares[i] / degrees[i]);
    std::printf("value %zu: deviations of %.2f stated errors\n", i, deviation);
    EXPECT_GT(deviation, 0.5) << i;
    EXPECT_LT(deviation, 1.25) << i;
  }
}

}  // namespace
}  // namespace earshot
