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

// Of 0 to 1000 steps on 70 to 690, and of 0 to 1 on 266 to 46: success 0.25 [0, 0.5] at 500 and 0.5 [0.25, 1] at 1000.
TEST(CurveSvg, HeldOutSuccessHasItsIntervalAndARingAtTheBest) {
  const auto point = [](std::uint64_t update, std::uint64_t steps, double success, double low, double high) {
    return CurvePoint{update,
                      steps,
                      0,
                      {{"held_out/argmax_success", success},
                       {"held_out/argmax_success_low", low},
                       {"held_out/argmax_success_high", high},
                       {"held_out/sample_success", success / 2},
                       {"held_out/best_update", static_cast<double>(update)},
                       {"held_out/best_success", success}}};
  };
  const std::string svg = curve_svg("run", {point(5, 500, 0.25, 0, 0.5), point(10, 1000, 0.5, 0.25, 1)});
  EXPECT_THAT(svg, HasSubstr("380.0,156.0 690.0,46.0 690.0,211.0 380.0,266.0")) << "the interval";
  EXPECT_THAT(svg, HasSubstr("380.0,211.0 690.0,156.0")) << "argmax";
  EXPECT_THAT(svg, HasSubstr("380.0,238.5 690.0,211.0")) << "sampled";
  EXPECT_THAT(svg, testing::ContainsRegex("<circle cx=.690.0. cy=.156.0."));
  EXPECT_THAT(curve_svg("run", {{1, 10, 0, {{"episodes/success", 0.5}}}}), testing::Not(HasSubstr("held-out")));
}

TEST(CurveSvg, LeavesOutWhatDoesNotExist) {
  EXPECT_THAT(curve_svg("empty", {}), testing::Not(HasSubstr("<polyline")));
  EXPECT_THAT(curve_svg("none", {{1, 10, 0, {{"episodes/success", std::nan("")}}}}), testing::Not(HasSubstr("nan")));
}

}  // namespace
}  // namespace earshot
