// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/truth_halves.h"

#include <gtest/gtest.h>

#include <vector>

namespace earshot {
namespace {

TruthHalves shoebox_truth(int rounds, int poses = 2) {
  const BenchScene scene = load_bench_scene("shoebox", "shoebox:6x3x5@0.3");
  TruthHalves truth(scene.scene, scene.source(), scene.some_poses(poses), 256);
  for (int i = 0; i < rounds; ++i) truth.add_round();
  return truth;
}

double late_energy(const EnergyResponse& response) {
  double sum = 0;
  for (int bin = 0; bin < response.late.num_bins(); ++bin)
    for (int band = 0; band < response.late.num_bands(); ++band) sum += static_cast<double>(response.late.energy(bin, band));
  return sum;
}

// Seeds differ from half to half, from pose to pose and from round to round, and nothing else decides.
TEST(TruthHalves, AreIndependentAndReproducible) {
  const TruthHalves seed1 = shoebox_truth(1), seed1_again = shoebox_truth(1), seed2 = shoebox_truth(2);
  const double first = late_energy(seed1.half(0, 0)), second = late_energy(seed1.half(0, 1));
  EXPECT_NE(first, second);
  EXPECT_EQ(first, late_energy(seed1_again.half(0, 0)));
  EXPECT_NE(first, late_energy(seed2.half(0, 0)));
  EXPECT_EQ(seed1.half(0, 0).arrivals.size(), seed1.half(0, 1).arrivals.size());
  // Runs add up to means: energies agree within what 256 rays scatter by.
  EXPECT_NEAR(first / late_energy(seed2.mean(0)), 1, 0.2);
  EXPECT_NEAR(second / late_energy(seed2.mean(0)), 1, 0.2);
  EXPECT_NEAR(late_energy(seed1.mean(0)), 0.5 * (first + second), 1e-4 * first);
}

// Sixteen times the runs: a quarter of the error, between a half and an eighth whatever the draw (42 values of each kind).
TEST(TruthHalves, MoreRoundsLowerTheError) {
  const double one_run = shoebox_truth(1, 6).t20_error(), sixteen_runs = shoebox_truth(16, 6).t20_error();
  EXPECT_GT(sixteen_runs, 0);
  EXPECT_LT(sixteen_runs, one_run / 2);
  EXPECT_GT(sixteen_runs, one_run / 8);
}

}  // namespace
}  // namespace earshot
