// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/cross_validation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace earshot {
namespace {

// Places with means 1 and 3 and another number of values each: the mean is over values, the error of the spread of 1 and 3 about it.
TEST(PlaceMean, WeighsValuesAndTakesItsErrorFromThePlaces) {
  PlaceMean mean(3);
  mean.add(0, 1);
  mean.add(1, 2);
  mean.add(1, 4);
  EXPECT_EQ(mean.count(), 3);
  EXPECT_NEAR(mean.mean(), 7.0 / 3, 1e-12);
  EXPECT_NEAR(mean.standard_error(), std::sqrt((16.0 / 9 + 4.0 / 9) / 2), 1e-12);
  EXPECT_TRUE(std::isnan(PlaceMean(2).mean()));
  EXPECT_TRUE(std::isnan(root_mean_square(PlaceMean(2)).value));
}

TEST(RootMeanSquare, OfANegativeMeanIsZeroWithWhatNoiseMayHide) {
  PlaceMean squares(2);
  squares.add(0, -3);
  squares.add(1, -1);
  const RootMeanSquare root = root_mean_square(squares);
  EXPECT_EQ(root.value, 0);
  EXPECT_NEAR(root.standard_error, 1, 1e-12);  // root of one standard error, 1
  EXPECT_NEAR(root_mean_square(squares, 1).value, 1, 1e-12);
}

// A test with a bias of 3 and a scatter of 2 against two estimates of the truth that scatter by 4 each: bias^2 = 9, variance = 4, square =
// 13.  Of 40,000 places the standard errors of the three are below 0.25; four of them are the tolerance.  Without the second estimate the
// square would be 29.
TEST(CrossValidation, GivesBackAKnownBiasAndAKnownNoise) {
  constexpr std::size_t places = 40'000;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  PlaceMean square(places), bias(places), variance(places);
  for (std::size_t p = 0; p < places; ++p) {
    const double truth = 10 * normal(random), one = truth + 4 * normal(random), two = truth + 4 * normal(random);
    const double x1 = truth + 3 + 2 * normal(random), x2 = truth + 3 + 2 * normal(random);
    const CrossValidatedSquare parts =
        cross_validate((x1 - one) * (x1 - two), (x2 - one) * (x2 - two), (x1 - one) * (x2 - two), (x2 - one) * (x1 - two));
    square.add(p, parts.square);
    bias.add(p, parts.bias);
    variance.add(p, parts.variance);
  }
  for (const auto& [mean, expected] : {std::pair{&square, 13.0}, std::pair{&bias, 9.0}, std::pair{&variance, 4.0}}) {
    EXPECT_LT(mean->standard_error(), 0.25);
    EXPECT_NEAR(mean->mean(), expected, 4 * mean->standard_error());
  }
}

}  // namespace
}  // namespace earshot
