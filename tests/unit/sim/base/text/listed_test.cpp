// SPDX-License-Identifier: Apache-2.0
#include "sim/base/text/listed.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

namespace earshot {
namespace {

TEST(Listed, PutsTheSeparatorBetweenElements) {
  EXPECT_EQ(listed(std::vector<int>{}, ", "), "");
  EXPECT_EQ(listed(std::vector<int>{7}, ", "), "7");
  EXPECT_EQ(listed(std::vector<int>{-1, 0, 12}, ", "), "-1, 0, 12");
  EXPECT_EQ(listed(std::set<std::string>{"b", "", "a"}, "|"), "|a|b");
  EXPECT_EQ(listed(std::vector<float>{0.1f, 2.0f, 1e-7f}, "x"), "0.1x2x1e-07");
}

}  // namespace
}  // namespace earshot
