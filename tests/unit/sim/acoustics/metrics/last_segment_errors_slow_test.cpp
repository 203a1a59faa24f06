// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <random>
#include <vector>

#include "sim/acoustics/core/energy_decay.h"
#include "sim/acoustics/metrics/standard_errors.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

struct MirrorRoom {
  std::array<double, 3> size_m, source, listener;
  double hard, soft;  ///< absorption of the walls across x, of all others

  /// Energies of all images (Allen and Berkley 1979) but the first, from its arrival on.
  [[nodiscard]] std::vector<double> images(double bin_s, double length_s) const {
    const double per_area = 1 / (16 * std::numbers::pi * std::numbers::pi);
    std::array<std::vector<std::array<double, 2>>, 3> rows;  // offset, fraction kept
    const double first_m = distance_m(), reach_m = first_m + length_s * rooms::kSpeedMPerS;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int count = static_cast<int>(reach_m / size_m[axis]) + 2;
      for (int n = -count; n <= count; ++n) {
        const double at = n * size_m[axis] + (n % 2 == 0 ? source[axis] : size_m[axis] - source[axis]);
        const double kept = std::pow(1 - (axis == 0 ? hard : soft), std::abs(n));
        if (kept > 1e-9) rows[axis].push_back({at - listener[axis], kept});
      }
    }
    std::vector<double> series(static_cast<std::size_t>(length_s / bin_s), 0.0);
    for (const auto& x : rows[0])
      for (const auto& y : rows[1])
        for (const auto& z : rows[2]) {
          const double r = std::sqrt(x[0] * x[0] + y[0] * y[0] + z[0] * z[0]);
          const auto bin = static_cast<std::size_t>((r - first_m) / rooms::kSpeedMPerS / bin_s);
          if (r > first_m + 1e-9 && bin < series.size()) series[bin] += per_area * x[1] * y[1] * z[1] / (r * r);
        }
    return series;
  }
  [[nodiscard]] double distance_m() const {
    double sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) sum += (source[axis] - listener[axis]) * (source[axis] - listener[axis]);
    return std::sqrt(sum);
  }
};

// `fast` takes the last segment of late paths as diffuse, and rows of images with few side walls alone: between two hard walls its T20 was
// 0.93 s with a stated error of 0.02 s where images have 1.22 s.
TEST(StandardErrorsSlow, CoverTheBiasOfDiffuseLastSegmentsBetweenHardWalls) {
  std::mt19937 draw(4);
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(draw); };
  struct Count {
    const char* name;
    std::optional<double> BandMetrics::*value;
    int covered = 0, values = 0;
    double error2 = 0, stated2 = 0;  ///< sums of squares
  };
  std::array<Count, 4> counts{
      {{"t20_s", &BandMetrics::t20_s}, {"c80_db", &BandMetrics::c80_db}, {"g_db", &BandMetrics::g_db}, {"edt_s", &BandMetrics::edt_s}}};
  for (int number = 0; number < 10; ++number) {
    MirrorRoom room{{6, 5, 3}, {1.7, 1.4, 1.2}, {4.1, 3.0, 1.5}, 0.05, 0.6};  // the first has the numbers above
    if (number > 0) {
      room.size_m = {uniform(4, 8), uniform(3, 6), uniform(2.5, 4)};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        room.source[axis] = room.size_m[axis] * uniform(0.15, 0.4);
        room.listener[axis] = room.size_m[axis] * uniform(0.55, 0.85);
      }
      room.hard = uniform(0.03, 0.15), room.soft = uniform(0.5, 0.9);
    }
    std::array<Material, 6> walls = rooms::uniform_walls(room.soft, 0);
    walls[0] = walls[1] = rooms::uniform_walls(room.hard, 0)[0];
    const auto box = rooms::box(room.size_m[0], room.size_m[1], room.size_m[2], walls);
    const double direct = 1 / std::pow(4 * std::numbers::pi * room.distance_m(), 2);
    const BandMetrics truth = measure_band(room.images(1e-3, 3), 1e-3, direct);
    for (int seed = 1; seed <= 4; ++seed) {
      AcousticConfig config = acoustic_preset("fast");
      config.seed = static_cast<std::uint64_t>(seed);
      config.air_absorption = Switch::off;
      config.bands = 1;
      config.rir_length_s = 0;
      const AcousticScene scene(box, config);
      const auto at = [](const std::array<double, 3>& p) { return rooms::point(p[0], p[1], p[2]); };
      const EarlyCandidates candidates(scene, at(room.source));
      EnergyResponse response;
      compute_energy_response(scene, candidates, at(room.listener), response);
      const BandMetrics found = measure(scene, response).bands[0];
      const BandMetrics error = standard_errors(scene, candidates, nullptr, at(room.listener), response).bands[0];
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
