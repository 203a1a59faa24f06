// SPDX-License-Identifier: Apache-2.0
#include "trainer/curves/curve_svg.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace earshot {
namespace {

using testing::HasSubstr;

// Success 0.5 at the end of the axis lies in the middle of the upper panel (46 + 220 / 2) at its right edge (70 + 620).
TEST(CurveSvg, DrawsPointsWhereTheyBelong) {
  const std::string svg = curve_svg("run", {{1, 0, 0, {{"episodes/success", 0.0}}}, {2, 1000, 1, {{"episodes/success", 0.5}}}});
  EXPECT_THAT(svg, HasSubstr("70.0,266.0 690.0,156.0"));
  EXPECT_THAT(svg, HasSubstr("</svg>"));
}

TEST(CurveSvg, LeavesOutWhatDoesNotExist) {
  EXPECT_THAT(curve_svg("empty", {}), testing::Not(HasSubstr("<polyline")));
  EXPECT_THAT(curve_svg("none", {{1, 10, 0, {{"episodes/success", std::nan("")}}}}), testing::Not(HasSubstr("nan")));
}

}  // namespace
}  // namespace earshot
