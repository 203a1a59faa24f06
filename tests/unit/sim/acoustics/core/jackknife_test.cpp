// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/jackknife.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <vector>

namespace earshot {
namespace {

TEST(Jackknife, StudentFactorsAreThoseOfTheTable) {
  // t(0.975) over 1.959964 (Abramowitz and Stegun 1964, table 26.10).
  const double table[][2] = {{1, 12.706}, {2, 4.303},  {3, 3.182},  {4, 2.776}, {5, 2.571},
                             {7, 2.365},  {10, 2.228}, {15, 2.131}, {60, 2.000}};
  for (const auto& [degrees, quantile] : table) EXPECT_NEAR(student_factor(degrees), quantile / 1.959964, 0.01 * quantile / 1.959964);
}

TEST(Jackknife, ErrorOfAMeanIsThatOfItsValuesLeftOut) {
  const std::vector<double> values{1, 2, 4, 8};  // mean 3.75, squared deviations 28.75
  EXPECT_NEAR(*error_of_mean(values), std::sqrt(28.75 / 3 / 4), 1e-12);
  std::vector<std::optional<double>> left_out;
  for (const double value : values) left_out.emplace_back((15 - value) / 3);
  EXPECT_NEAR(*jackknife_error(left_out), *error_of_mean(values), 1e-12);
  EXPECT_FALSE(error_of_mean(std::vector<double>{1}));
}

}  // namespace
}  // namespace earshot
