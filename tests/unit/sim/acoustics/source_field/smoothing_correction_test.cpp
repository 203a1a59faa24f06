// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/source_field/smoothing_correction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

constexpr std::size_t kBands = 8;
constexpr int kSweeps = 4;

/// A corridor of 24 cells of 1 m, closed at both ends, and times of which the last three quarters are smoothed.
struct Corridor {
  std::shared_ptr<const Scene> scene = rooms::box(24, 2, 2, rooms::uniform_walls(0.1, 0.5));
  FieldGrid grid{*scene, 1.f};
  FieldSmoothing smoothing{grid};
  std::vector<std::uint32_t> active = smoothing.reachable(std::vector<bool>(grid.size(), true));
  WideningBins bins{200};
  std::vector<int> sweeps = std::vector<int>(bins.size(), kSweeps);

  Corridor() { std::fill_n(sweeps.begin(), 20, 0); }

  /// Metres from the end where the corridor begins to the middle of a cell.
  [[nodiscard]] double along(std::uint32_t cell) const { return std::floor(double{grid.inside(cell).x}) + 0.5; }
  [[nodiscard]] SmoothingCorrection correct(const SmoothingCorrection::RawEnergy& raw) const {
    return {smoothing, bins, sweeps, grid.size(), active, kBands, raw};
  }
};

/// Energy exp(-x / 1.25 m): a sweep multiplies it by 1 + (cosh(0.8) - 1) / 4, and cells and the blend between them count as one more.
/// Noise-free, so all of it is taken back.
TEST(SmoothingCorrection, ContinuesAGradientToNoBlur) {
  const Corridor corridor;
  constexpr double per_m = 0.8;
  const SmoothingCorrection correction = corridor.correct([&](std::uint32_t cell, std::size_t merged, std::span<float> energy) {
    for (std::size_t b = 0; b < kBands; ++b)
      energy[b] = static_cast<float>(static_cast<double>(corridor.bins.width(merged)) *
                                     std::exp(-per_m * corridor.along(cell) - 0.02 * corridor.bins.middle(merged)));
    return true;
  });
  const double sweep = 1 + (std::cosh(per_m) - 1) / 4, expected = std::pow(sweep, -(kSweeps + 1));
  ASSERT_LT(expected, 0.7);
  std::array<float, kBands> factors{};
  int inner = 0;
  for (const std::uint32_t cell : corridor.active) {
    // The ends reflect: as far as sweeps reach, energy is none of an exponential.
    if (corridor.along(cell) < kSweeps + 1 || corridor.along(cell) > 24 - kSweeps - 1) continue;
    ++inner;
    for (const std::size_t merged : {corridor.bins.size() / 2, corridor.bins.size() - 1}) {
      correction.factors(cell, merged, factors);
      for (const float factor : factors) EXPECT_NEAR(factor, expected, 0.005) << corridor.along(cell) << " m, bin " << merged;
    }
    correction.factors(cell, 0, factors);
    EXPECT_EQ(factors[0], 1.f) << "nothing is smoothed yet";
  }
  EXPECT_GE(inner, 40);
}

/// Noise of 25 % in every cell and bin of a uniform field: the correction must not put back what smoothing took out.
TEST(SmoothingCorrection, LeavesNoiseSmoothed) {
  const Corridor corridor;
  const auto raw = [&](std::uint32_t cell, std::size_t merged, std::span<float> energy) {
    for (std::size_t b = 0; b < kBands; ++b) {
      const auto u = RandomStream(7, Purpose::test, cell, static_cast<std::uint32_t>(merged)).uniform4(static_cast<std::uint32_t>(b));
      // Uniform over [1 - d, 1 + d]: its deviation is d / sqrt(3).
      energy[b] = static_cast<float>(corridor.bins.width(merged)) * (1 + 0.25f * 1.7320508f * (2 * u[0] - 1));
    }
    return true;
  };
  const SmoothingCorrection correction = corridor.correct(raw);
  // Over the smoothed bins together, as T20 takes them: variance without the correction, and with it.
  const std::size_t width = corridor.bins.size() * kBands;
  std::vector<float> rows(corridor.grid.size() * width, 0.f), spare;
  for (const std::uint32_t cell : corridor.active)
    for (std::size_t merged = 0; merged < corridor.bins.size(); ++merged)
      raw(cell, merged, std::span(&rows[cell * width + merged * kBands], kBands));
  corridor.smoothing.sweep(kSweeps, width, corridor.active, rows, spare);
  double before = 0, after = 0, expected = 0;
  for (std::size_t merged = 30; merged < corridor.bins.size(); ++merged) expected += static_cast<double>(corridor.bins.width(merged));
  std::array<float, kBands> factors{};
  for (const std::uint32_t cell : corridor.active) {
    std::array<double, kBands> smooth{}, corrected{};
    for (std::size_t merged = 30; merged < corridor.bins.size(); ++merged) {
      correction.factors(cell, merged, factors);
      for (std::size_t b = 0; b < kBands; ++b) {
        const double energy = double{rows[cell * width + merged * kBands + b]};
        smooth[b] += energy;
        corrected[b] += energy * double{factors[b]};
      }
    }
    for (std::size_t b = 0; b < kBands; ++b) {
      before += std::pow(smooth[b] / expected - 1, 2);
      after += std::pow(corrected[b] / expected - 1, 2);
    }
  }
  ASSERT_GT(before, 0);
  // Without a test of significance it would be some 2.5 times: noise after one sweep, continued by (n + 1) / (n - 1).
  EXPECT_LT(after / before, 1.5);
}

TEST(SmoothingCorrection, IsEmptyWhereNothingIsSmoothed) {
  Corridor corridor;
  std::fill(corridor.sweeps.begin(), corridor.sweeps.end(), 0);
  const SmoothingCorrection correction = corridor.correct([](std::uint32_t, std::size_t, std::span<float> energy) {
    std::fill(energy.begin(), energy.end(), 1.f);
    return true;
  });
  EXPECT_TRUE(correction.empty());
  std::array<float, kBands> factors{};
  correction.factors(corridor.active.front(), corridor.bins.size() - 1, factors);
  EXPECT_EQ(factors[0], 1.f);
}

}  // namespace
}  // namespace earshot
