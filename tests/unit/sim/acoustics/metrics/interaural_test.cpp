// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/interaural.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numbers>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/synthesis_cases.h"

namespace earshot {
namespace {

using namespace synthesis_cases;

std::vector<float> noise(std::size_t count, std::uint32_t stream) {
  const RandomStream random(41, Purpose::test, stream);
  std::vector<float> samples(count);
  for (std::size_t n = 0; n + 1 < count; n += 2) {
    const auto pair = random.normal2(static_cast<std::uint32_t>(n));
    samples[n] = pair[0], samples[n + 1] = pair[1];
  }
  return samples;
}

TEST(OracleO26, IdenticalAndInvertedEarsCorrelateFully) {
  const auto left = noise(16000, 1);
  auto inverted = left, late = left, quiet = left;
  for (float& value : inverted) value = -value;
  for (float& value : quiet) value *= 0.1f;
  std::rotate(late.rbegin(), late.rbegin() + 8, late.rend());  // 0.5 ms
  for (const int band : {-1, 0, 3, 6}) {
    EXPECT_NEAR(*interaural_correlation(left, left, 16000.f, 0.0, band).total, 1.0, 1e-4);
    EXPECT_NEAR(*interaural_correlation(left, inverted, 16000.f, 0.0, band).early, 1.0, 1e-4);
    EXPECT_NEAR(*interaural_correlation(left, quiet, 16000.f, 0.0, band).late, 1.0, 1e-4);
    EXPECT_NEAR(*interaural_correlation(left, late, 16000.f, 0.0, band).total, 1.0, 0.01) << band;  // the window cuts 8 samples
  }
  // Beyond 1 ms it is not found: white noise apart by 2 ms.
  std::rotate(late.rbegin(), late.rbegin() + 24, late.rend());
  EXPECT_LT(*interaural_correlation(left, late, 16000.f, 0.0).total, 0.05);
}

TEST(OracleO26, LagsLieBetweenSamples) {
  // 4 kHz at 16 kHz: four samples to a period, so whole samples alone could miss a factor cos(pi / 4).
  std::vector<float> left(8000), right(8000);
  for (std::size_t n = 0; n < left.size(); ++n) {
    const double x = 2.0 * std::numbers::pi * 0.249 * static_cast<double>(n),
                 window = std::exp(-std::pow((static_cast<double>(n) - 4000.0) / 60.0, 2));
    left[n] = static_cast<float>(window * std::cos(x));
    right[n] = static_cast<float>(window * std::cos(x + 0.25 * std::numbers::pi));
  }
  EXPECT_NEAR(*interaural_correlation(left, right, 16000.f, 0.0).total, 1.0, 0.01);
}

// Maximum over +-1 ms of two independent noises in the octave at 500 Hz: mean and standard deviation of the table.
TEST(OracleO26, IndependentNoisesCorrelateByChance) {
  struct Row {
    double length_s, mean, deviation;
    double sum, square;
  };
  std::array<Row, 3> rows = {Row{0.08, 0.183, 0.074, 0, 0}, Row{0.42, 0.080, 0.034, 0, 0}, Row{1.0, 0.052, 0.020, 0, 0}};
  constexpr int draws = 60;
  for (std::uint32_t draw = 0; draw < draws; ++draw) {
    // Long enough that the filter has settled at both ends of the window; lengths other than 80 ms go by the total.
    const auto left = octave_band(noise(32768, 1000 + 2 * draw), 501.187, 16000.0),
               right = octave_band(noise(32768, 1001 + 2 * draw), 501.187, 16000.0);
    for (Row& row : rows) {
      const auto count = static_cast<std::size_t>(row.length_s * 16000.0);
      const double value =
          *interaural_correlation(std::span(left).subspan(8192, count), std::span(right).subspan(8192, count), 16000.f, 0.0).total;
      row.sum += value, row.square += value * value;
    }
  }
  for (const Row& row : rows) {
    const double mean = row.sum / draws, deviation = std::sqrt(row.square / draws - mean * mean);
    // Three standard errors of the mean, and 10 % for octave filters of another shape than the table's.
    EXPECT_NEAR(mean, row.mean, 3.0 * row.deviation / std::sqrt(draws) + 0.1 * row.mean) << row.length_s;
    EXPECT_NEAR(deviation, row.deviation, 0.35 * row.deviation) << row.length_s;
  }
}

TEST(Interaural, WindowsCountFromTheDirectSound) {
  // Same click in both ears at 100 ms, then, after 80 ms, the right ear alone has another sound.
  std::vector<float> left(16000, 0.f), right(16000, 0.f);
  left[1600] = right[1600] = 1.f;
  left[1600 + 2000] = 1.f;
  right[1600 + 3000] = 1.f;
  const InterauralCorrelation iacc = interaural_correlation(left, right, 16000.f, 0.1);
  EXPECT_NEAR(*iacc.early, 1.0, 1e-4);
  EXPECT_NEAR(*iacc.late, 0.0, 1e-3);
  EXPECT_NEAR(*iacc.total, 0.5, 1e-3);
  EXPECT_FALSE(interaural_correlation(left, std::vector<float>(16000, 0.f), 16000.f, 0.1).total.has_value());
  EXPECT_THROW(interaural_correlation(left, std::vector<float>(100, 0.f), 16000.f, 0.1), InputError);
  EXPECT_THROW(interaural_correlation(left, right, 16000.f, -1.0), InputError);
  EXPECT_THROW(interaural_correlation(left, right, 16000.f, 0.1, 7), InputError);
}

// A frontal direct sound correlates fully; a diffuse tail at 125 Hz is nearly coherent, at 1 kHz it is not (docs/evidence/oracles.md,
// O-27).
TEST(Interaural, MetricsOfABinauralResponseHaveIt) {
  RirSynthesizer synthesizer(binaural_tables());
  EnergyResponse response = response_with({arrival_at(3.43, 0.05, {0, 0, -1})});
  response.late = decay_of(1.0, 0.002, 7);
  const Rir rir = rendered(synthesizer, response);
  const RoomMetrics metrics = measure(rir, 0.01);
  ASSERT_EQ(metrics.bands.size(), 7u);
  ASSERT_TRUE(metrics.bands[0].iacc_late && metrics.bands[3].iacc_late && metrics.bands[3].iacc_early);
  EXPECT_GT(*metrics.bands[0].iacc_late, 0.85);
  EXPECT_LT(*metrics.bands[3].iacc_late, 0.4);
  EXPECT_GT(*metrics.bands[3].iacc_early, *metrics.bands[3].iacc_late);
  ASSERT_TRUE(metrics.bands[3].c80_db.has_value());  // all else is that of the left ear
  EXPECT_EQ(metrics.bands[3].c80_db, measure(rir.channel(0), 16000.f, 0.01).bands[3].c80_db);
  RirSynthesizer mono = usual_mono();
  EXPECT_FALSE(measure(rendered(mono, response), 0.01).bands[3].iacc.has_value());
}

}  // namespace
}  // namespace earshot
