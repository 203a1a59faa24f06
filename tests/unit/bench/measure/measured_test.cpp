// SPDX-License-Identifier: Apache-2.0
#include "bench/measure/measured.h"

#include <gtest/gtest.h>

#include "sim/base/errors.h"

namespace earshot {
namespace {

TEST(Measured, MedianOfOddAndEvenCounts) {
  EXPECT_EQ(median_of({3, 1, 2}).value, 2);
  EXPECT_EQ(median_of({4, 1, 2, 3}).value, 2.5);
  EXPECT_EQ(median_of({4, 1, 2, 3}).min, 1);
  EXPECT_EQ(median_of({4, 1, 2, 3}).max, 4);
  EXPECT_THROW(median_of({}), InputError);
}

TEST(Measured, PercentileIsOneOfTheValues) {
  const std::vector<double> values{40, 10, 30, 20};
  EXPECT_EQ(percentile(values, 0.25), 10);
  EXPECT_EQ(percentile(values, 0.26), 20);
  EXPECT_EQ(percentile(values, 0.5), 20);
  EXPECT_EQ(percentile(values, 0.99), 40);
  EXPECT_EQ(percentile(values, 1), 40);
  EXPECT_EQ(percentile({}, 0.5), 0);
}

}  // namespace
}  // namespace earshot
