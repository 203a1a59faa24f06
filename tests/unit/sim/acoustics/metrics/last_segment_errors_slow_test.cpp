// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "sim/acoustics/core/energy_decay.h"
#include "sim/acoustics/metrics/standard_errors.h"
#include "tests/support/acoustics/image_sum.h"

namespace earshot {
namespace {

// `fast` takes the last segment of late paths as diffuse, and rows of images with few side walls alone: between two hard walls its T20 was
// 0.93 s with a stated error of 0.02 s where images have 1.22 s.
TEST(StandardErrorsSlow, CoverTheBiasOfDiffuseLastSegmentsBetweenHardWalls) {
  struct Count {
    const char* name;
    std::optional<double> BandMetrics::*value;
    int covered = 0, values = 0;
    double error2 = 0, stated2 = 0;  ///< sums of squares
  };
  std::array<Count, 4> counts{
      {{"t20_s", &BandMetrics::t20_s}, {"c80_db", &BandMetrics::c80_db}, {"g_db", &BandMetrics::g_db}, {"edt_s", &BandMetrics::edt_s}}};
  for (const image_sum::MirrorRoom& room : image_sum::mirror_rooms(10)) {
    const auto box = room.scene();
    const double direct = 1 / std::pow(4 * std::numbers::pi * room.distance_m(), 2);
    const BandMetrics truth = measure_band(room.images(1e-3, 3), 1e-3, direct);
    for (int seed = 1; seed <= 4; ++seed) {
      AcousticConfig config = acoustic_preset("fast");
      config.seed = static_cast<std::uint64_t>(seed);
      config.air_absorption = Switch::off;
      config.bands = 1;
      config.rir_length_s = 0;
      const AcousticScene scene(box, config);
      const glm::vec3 listener = room.place(room.listener);
      const EarlyCandidates candidates(scene, room.place(room.source));
      EnergyResponse response;
      compute_energy_response(scene, candidates, listener, response);
      const BandMetrics found = measure(scene, response).bands[0];
      const BandMetrics error = standard_errors(scene, candidates, nullptr, listener, response).bands[0];
      for (Count& count : counts) {
        const auto value = count.value;
        if (!(truth.*value) || !(found.*value) || !(error.*value)) continue;
        ++count.values;
        count.covered += std::abs(*(found.*value) - *(truth.*value)) <= 2 * *(error.*value);
        count.error2 += std::pow(*(found.*value) - *(truth.*value), 2);
        count.stated2 += std::pow(*(error.*value), 2);
      }
    }
  }
  for (const Count& count : counts) {
    std::printf("%s: %d of %d values within twice the stated error\n", count.name, count.covered, count.values);
    ASSERT_GE(count.values, 30) << count.name;
    // 95 % of independent values; seeds of a room share its bias, so that a room at the edge counts four times.
    EXPECT_GE(count.covered, 0.85 * count.values) << count.name;
    // Errors that are stated without need cover everything: root mean squares, 2.5 for a bound on a bias beside scatter.
    std::printf("  stated %.3g, made %.3g\n", std::sqrt(count.stated2 / count.values), std::sqrt(count.error2 / count.values));
    EXPECT_LT(std::sqrt(count.stated2), 2.5 * std::sqrt(count.error2)) << count.name;
  }
}

}  // namespace
}  // namespace earshot
