// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/error_coverage.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>

namespace earshot {
namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();
using Errors = std::array<std::optional<double>, 2>;

TEST(ErrorCoverage, ComparesTheMeanOfBandsWithTwoStandardErrorsOfBoth) {
  ErrorCoverage coverage;
  // Twice the root of 0.03^2 + 0.04^2 is 0.1.
  coverage.add(std::array{0.05, -0.149}, 0.03, Errors{0.04, 0.04});
  EXPECT_EQ(coverage.covered, 1);
  coverage.add(std::array{0.05, -0.151}, 0.03, Errors{0.04, 0.04});
  EXPECT_EQ(coverage.covered, 1);
  EXPECT_EQ(coverage.poses, 2);
}

TEST(ErrorCoverage, CountsNoPoseWithoutABand) {
  ErrorCoverage coverage;
  coverage.add(std::array{kMissing, kMissing}, 0.03, Errors{});
  EXPECT_EQ(coverage.poses, 0);
  coverage.add(std::array{kMissing, 0.05}, 0.03, Errors{std::nullopt, 0.0});
  EXPECT_EQ(coverage.poses, 1);
  EXPECT_EQ(coverage.covered, 1);
}

}  // namespace
}  // namespace earshot
