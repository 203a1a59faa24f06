// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

// docs/reference/conventions.md, section 1: -z ahead at heading 0, counter-clockwise from above, so a quarter turn left looks along -x.
TEST(Camera, HeadingsTurnCounterClockwiseFromMinusZ) {
  const double quarter = std::numbers::pi / 2;
  const float tolerance = 1e-7f;  // pi is rounded
  EXPECT_NEAR(glm::distance(forward_of(0), {0, 0, -1}), 0.f, tolerance);
  EXPECT_NEAR(glm::distance(forward_of(quarter), {-1, 0, 0}), 0.f, tolerance);
  EXPECT_NEAR(glm::distance(forward_of(-quarter), {1, 0, 0}), 0.f, tolerance);
  EXPECT_NEAR(glm::distance(forward_of(2 * quarter), {0, 0, 1}), 0.f, tolerance);
  EXPECT_NEAR(glm::distance(right_of(0), {1, 0, 0}), 0.f, tolerance);
  EXPECT_NEAR(glm::distance(right_of(quarter), {0, 0, -1}), 0.f, tolerance);
}

TEST(Camera, RightIsForwardCrossUp) {
  for (int degrees = -720; degrees <= 720; degrees += 7) {
    const double heading = degrees * std::numbers::pi / 180.0;
    const glm::vec3 expected = glm::cross(forward_of(heading), glm::vec3(0, 1, 0));
    EXPECT_NEAR(glm::distance(right_of(heading), expected), 0.f, 1e-6f) << degrees;
    EXPECT_NEAR(glm::length(right_of(heading)), 1.f, 1e-6f);
  }
}

TEST(Camera, RefusesWhatNoPinholeCanDo) {
  EXPECT_NO_THROW(validate(CameraConfig{}));
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  EXPECT_THROW(validate(CameraConfig{.width_px = 0}), InputError);
  EXPECT_THROW(validate(CameraConfig{.width_px = 127}), InputError);
  EXPECT_THROW(validate(CameraConfig{.width_px = -8}), InputError);
  EXPECT_THROW(validate(CameraConfig{.height_px = 0}), InputError);
  for (const float fov_deg : {0.f, 1.f, 179.f, 180.f, -90.f, nan})
    EXPECT_THROW(validate(CameraConfig{.horizontal_fov_deg = fov_deg}), InputError);
  for (const float height_m : {0.f, -1.f, nan, infinity}) EXPECT_THROW(validate(CameraConfig{.height_m = height_m}), InputError);
  for (const float depth_m : {0.f, -10.f, nan, infinity}) EXPECT_THROW(validate(CameraConfig{.max_depth_m = depth_m}), InputError);
}

}  // namespace
}  // namespace earshot
