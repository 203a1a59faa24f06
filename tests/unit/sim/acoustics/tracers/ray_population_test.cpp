// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/tracers/ray_population.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <vector>

namespace earshot {
namespace {

TEST(RayPopulation, EffectiveCount) {
  EXPECT_DOUBLE_EQ(effective_sample_size(std::vector<double>{2, 2, 2, 2}), 4.0);
  EXPECT_DOUBLE_EQ(effective_sample_size(std::vector<double>{5, 0, 0}), 1.0);
  EXPECT_DOUBLE_EQ(effective_sample_size(std::vector<double>{3, 1}), 1.6);
  EXPECT_EQ(effective_sample_size(std::vector<double>{0, 0}), 0.0);
}

TEST(RayPopulation, MeanNumberOfCopiesIsProportionalToTheWeight) {
  const std::vector<double> weights = {0.1, 0.0, 2.7, 1.2, 1e-9, 4.0};
  const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
  for (const int target : {1, 5, 64}) {
    const int draws = 100000;
    std::vector<double> mean(weights.size(), 0.0);
    std::vector<int> copies(weights.size());
    for (int d = 0; d < draws; ++d) {
      systematic_resample(weights, target, (d + 0.5) / draws, copies);
      int total = 0;
      for (std::size_t i = 0; i < weights.size(); ++i) {
        const double fraction = target * weights[i] / sum;
        ASSERT_GE(copies[i], std::floor(fraction) - 1e-9);
        ASSERT_LE(copies[i], std::ceil(fraction) + 1e-9);
        mean[i] += static_cast<double>(copies[i]) / draws;
        total += copies[i];
      }
      ASSERT_EQ(total, target);
    }
    // Equally spaced draws: the mean over the random number is exact up to one draw.
    for (std::size_t i = 0; i < weights.size(); ++i) EXPECT_NEAR(mean[i], target * weights[i] / sum, 2.0 / draws) << target << " " << i;
  }
}

TEST(RayPopulation, TargetIsMetAtTheEndsOfTheRandomNumber) {
  std::vector<double> weights(256, 0.1);  // sums of 0.1 round
  std::vector<int> copies(weights.size());
  for (const double random : {0.0, 0.5, std::nextafter(1.0, 0.0)}) {
    for (const int target : {1, 255, 256}) {
      systematic_resample(weights, target, random, copies);
      EXPECT_EQ(std::accumulate(copies.begin(), copies.end(), 0), target);
    }
  }
}

}  // namespace
}  // namespace earshot
