// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "sim/base/errors.h"
#include "sim/vision/embree_camera.h"

namespace earshot {
namespace {

struct TestBox {
  glm::vec3 lower, upper;
};

Scene scene_of(const std::vector<TestBox>& boxes) {
  TriangleMesh mesh;
  for (const TestBox& box : boxes)
    append_box(mesh, box.lower, box.upper, intern(mesh.material_names, "plain"), intern(mesh.object_names, "box_0"));
  std::vector<Material> materials(mesh.material_names.size(), Material::uniform("plain", 0.1f, 0.1f));
  return Scene("test", std::move(mesh), std::move(materials), Air{});
}

std::vector<float> render(const Scene& scene, const CameraConfig& config, const Pose& pose) {
  std::vector<float> depth(static_cast<std::size_t>(config.width_px * config.height_px), -1.f);
  EmbreeCamera(sensor_of(config)).render(scene, nullptr, pose, {.depth = depth});
  return depth;
}

// The slab a to b across the view axis, large enough to fill any picture.
Scene wall_ahead(float distance_m) { return scene_of({{{-500, -500, -distance_m - 1}, {500, 500, -distance_m}}}); }

TEST(EmbreeDepth, WallAheadHasTheSameDepthInEveryPixel) {
  // z depth: 3 m of 10 everywhere; ray length would read 0.3 * sqrt(3) in the corners.
  for (const float depth : render(wall_ahead(3.f), {}, {})) EXPECT_NEAR(depth, 0.3f, 2e-6f);  // float rounding of t * cosine
}

TEST(EmbreeDepth, ObliqueWallFollowsThePlaneEquation) {
  // The plane x = 2 seen at heading 0: the ray (r, u, 1) meets it at depth 2 / r where r > 0.
  const Scene scene = scene_of({{{2, -500, -500}, {3, 500, 500}}});
  const CameraConfig config{.width_px = 64, .height_px = 48, .horizontal_fov_deg = 70.f, .max_depth_m = 20.f};
  const std::vector<float> depth = render(scene, config, {});
  for (int row = 0; row < 48; ++row)
    for (int column = 0; column < 64; ++column) {
      const double r = std::tan(35.0 * std::numbers::pi / 180.0) * (2.0 * (column + 0.5) / 64.0 - 1.0);
      const double expected = r > 0 ? std::min(2.0 / r / 20.0, 1.0) : 1.0;
      EXPECT_NEAR(depth[row * 64 + column], expected, 1e-4 * expected) << row << " " << column;
    }
}

TEST(EmbreeDepth, FieldOfViewEndsWhereItShould) {
  // At 90 degrees and depth 4 the picture is 8 m wide: pixel c looks at x = 8 (c + 0.5) / 128 - 4.  A panel from x = 1 to 2 covers
  // columns 80 to 95, and as pixels are square a panel from 1 to 2 m above the eye covers rows 32 to 47.
  const Scene scene = scene_of({{{1, 1.25f + 1, -4.0001f}, {2, 1.25f + 2, -4}}});
  const std::vector<float> depth = render(scene, {}, {});
  for (int row = 0; row < 128; ++row)
    for (int column = 0; column < 128; ++column) {
      const bool on_panel = column >= 80 && column < 96 && row >= 32 && row < 48;
      EXPECT_NEAR(depth[row * 128 + column], on_panel ? 0.4f : 1.f, 1e-5f) << row << " " << column;
    }
}

TEST(EmbreeDepth, PanoramicPixelsAreSquare) {
  // Twice as wide as high at 90 degrees: rows span +-26.57 degrees, so at depth 2 the lowest row looks 1 m (less half a pixel) down.
  const Scene floor = scene_of({{{-500, -1, -500}, {500, 0, 500}}});
  const CameraConfig config{.width_px = 64, .height_px = 32, .height_m = 1.f};
  const std::vector<float> depth = render(floor, config, {});
  for (int row = 0; row < 32; ++row) {
    const double down = (row + 0.5 - 16.0) / 32.0;  // tangent of the angle below the horizon
    const double expected = down > 0 ? std::min(1.0 / down / 10.0, 1.0) : 1.0;
    EXPECT_NEAR(depth[row * 64 + 10], expected, 1e-5) << row;
  }
}

TEST(EmbreeDepth, TurnsWithTheHeading) {
  // Four walls at different distances; each quarter turn to the left shows the next: -z, -x, +z, +x.
  const Scene scene = scene_of(
      {{{-50, -50, -3}, {50, 50, -2}}, {{-4, -50, -50}, {-3, 50, 50}}, {{-50, -50, 4}, {50, 50, 5}}, {{5, -50, -50}, {6, 50, 50}}});
  const CameraConfig config{.width_px = 16, .height_px = 16, .horizontal_fov_deg = 20.f};
  const float expected[] = {0.2f, 0.3f, 0.4f, 0.5f};
  for (int quarter = 0; quarter < 4; ++quarter)
    for (const float depth : render(scene, config, {.heading_rad = quarter * std::numbers::pi / 2}))
      EXPECT_NEAR(depth, expected[quarter], 1e-5f);
}

TEST(EmbreeDepth, MovesWithTheAgentAndItsEye) {
  const Scene scene = scene_of({{{-50, -1, -50}, {50, 0.5f, 50}}, {{-50, -1, -9}, {50, 50, -8}}});
  const CameraConfig config{.width_px = 8, .height_px = 2, .horizontal_fov_deg = 10.f, .height_m = 2.f};
  const std::vector<float> depth = render(scene, config, {.position = {1, 0.5f, -3}});
  for (const float value : depth) EXPECT_NEAR(value, 0.5f, 1e-5f);  // 5 m to the wall at z = -8; the floor is out of the picture
}

TEST(EmbreeDepth, ClipsAtTenMetresAndInTheOpen) {
  for (const float depth : render(wall_ahead(9.999f), {}, {})) EXPECT_NEAR(depth, 0.9999f, 1e-5f);
  for (const float depth : render(wall_ahead(10.5f), {}, {})) EXPECT_EQ(depth, 1.f);
  for (const float depth : render(scene_of({}), {}, {})) EXPECT_EQ(depth, 1.f);
}

TEST(EmbreeDepth, SameBitsEveryTimeAndNeverNaN) {
  const Scene scene = scene_of({{{-3, 0, -3}, {3, 2.5f, 3}}, {{0.5f, 0, 0.5f}, {1, 1, 1}}});
  const EmbreeCamera camera(sensor_of(CameraConfig{}));
  for (int step = 0; step < 40; ++step) {
    const Pose pose{.position = {-2.f + 0.1f * static_cast<float>(step), 0, 0.3f}, .heading_rad = 0.7 * step};
    std::vector<float> first(128 * 128), second(128 * 128);
    camera.render(scene, nullptr, pose, {.depth = first});
    EmbreeCamera(sensor_of(CameraConfig{})).render(scene, nullptr, pose, {.depth = second});
    EXPECT_EQ(first, second);
    for (const float depth : first) ASSERT_TRUE(depth >= 0.f && depth <= 1.f);
  }
}

TEST(EmbreeDepth, RefusesABadCamera) { EXPECT_THROW(EmbreeCamera({.width_px = 0}), InputError); }

}  // namespace
}  // namespace earshot
