// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/depth_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr CameraSensorConfig kCamera{.width_px = 128, .height_px = 128};

std::vector<float> noisy(const DepthNoiseConfig& config, float depth_m, DepthNoiseDraw draw = {}) {
  const std::vector<float> clean(128 * 128, depth_m / kCamera.max_depth_m);
  std::vector<float> result(clean.size(), -1.f);
  add_depth_noise(config, kCamera, draw, clean, result);
  return result;
}

struct Statistics {
  double mean_m = 0, sigma_m = 0;
};
Statistics statistics_of(const std::vector<float>& depth) {
  Statistics result;
  for (const float value : depth) result.mean_m += 10.0 * value / static_cast<double>(depth.size());
  for (const float value : depth) result.sigma_m += std::pow(10.0 * value - result.mean_m, 2) / static_cast<double>(depth.size());
  result.sigma_m = std::sqrt(result.sigma_m);
  return result;
}

TEST(DepthNoise, SpreadGrowsWithTheSquareOfTheDistance) {
  // z = f b / d, so sigma_z = z^2 / (f b) sigma_d.  Without steps the spread of d is that of the normal numbers.
  const DepthNoiseConfig smooth{.quantum_px = 0.f};
  for (const double z_m : {1.0, 2.0, 4.0, 8.0}) {
    const Statistics found = statistics_of(noisy(smooth, static_cast<float>(z_m)));
    const double expected_m = z_m * z_m / 35.13 * 0.027778;
    // 16,384 numbers know their spread to 0.6 % and their mean to 0.8 % of it; four sigma of each, and z''sigma^2/2 of the curve.
    EXPECT_NEAR(found.sigma_m, expected_m, 0.025 * expected_m) << z_m;
    EXPECT_NEAR(found.mean_m, z_m, 0.035 * expected_m + expected_m * expected_m / z_m) << z_m;
  }
}

TEST(DepthNoise, StepsAddTheirOwnSpread) {
  // A uniform error of q adds q^2 / 12 to the variance of the shift, on average over where the shift lies between steps.
  double variance_px2 = 0;
  constexpr int num_depths = 40;
  for (int i = 0; i < num_depths; ++i) {
    const double z_m = 3.0 + 0.005 * i, shift_px = 35.13 / z_m;
    for (const float value : noisy({}, static_cast<float>(z_m))) variance_px2 += std::pow(35.13 / (10.0 * value) - shift_px, 2);
  }
  variance_px2 /= num_depths * 128.0 * 128.0;
  const double expected = 0.027778 * 0.027778 + 0.125 * 0.125 / 12;
  EXPECT_NEAR(variance_px2, expected, 0.05 * expected);  // 40 depths over six steps; a missing term would be 37 % or more
}

TEST(DepthNoise, ValuesLieOnStepsOfTheShift) {
  for (const float value : noisy({}, 5.f)) {
    const double steps = 35.13 / (10.0 * value) / 0.125;
    EXPECT_NEAR(steps, std::round(steps), 1e-4);
  }
}

TEST(DepthNoise, JitterMovesEdgesByAboutItsSpread) {
  // Half near, half far: a pixel beside the edge takes the other side's depth if its number rounds to one, |n| > 0.5 of sigma 0.25: 2.3 %
  // each.
  std::vector<float> clean(128 * 128), result(128 * 128);
  for (std::size_t i = 0; i < clean.size(); ++i) clean[i] = i % 128 < 64 ? 0.1f : 0.5f;
  int crossed = 0;
  for (std::uint32_t step = 0; step < 50; ++step) {
    add_depth_noise({}, kCamera, {.step = step}, clean, result);
    for (std::size_t row = 0; row < 128; ++row) crossed += (result[row * 128 + 63] > 0.3f) + (result[row * 128 + 64] < 0.3f);
  }
  const double fraction = crossed / (50.0 * 128 * 2), expected = 0.02275;
  EXPECT_NEAR(fraction, expected, 4 * std::sqrt(expected * (1 - expected) / (50 * 128 * 2)));
}

TEST(DepthNoise, SameKeySameBitsAndEveryWordCounts) {
  const DepthNoiseDraw draw{.seed = 5, .env = 6, .episode = 7, .step = 8};
  const std::vector<float> reference = noisy({}, 3.f, draw);
  EXPECT_EQ(noisy({}, 3.f, draw), reference);
  for (const DepthNoiseDraw& other :
       {DepthNoiseDraw{4, 6, 7, 8}, DepthNoiseDraw{5, 5, 7, 8}, DepthNoiseDraw{5, 6, 6, 8}, DepthNoiseDraw{5, 6, 7, 7}})
    EXPECT_NE(noisy({}, 3.f, other), reference);
}

TEST(DepthNoise, EndsStayAndNothingLeavesTheRange) {
  for (const float value : noisy({}, 10.f)) EXPECT_EQ(value, 1.f);
  for (const float value : noisy({.disparity_px = 1.f}, 9.9f)) EXPECT_TRUE(value > 0.f && value <= 1.f);
  for (const float value : noisy({.disparity_px = 0.f, .jitter_px = 0.f, .quantum_px = 0.f}, 3.f)) EXPECT_NEAR(value, 0.3f, 1e-7f);
  EXPECT_THROW(validate(DepthNoiseConfig{.jitter_px = -1.f}), InputError);
}

}  // namespace
}  // namespace earshot
