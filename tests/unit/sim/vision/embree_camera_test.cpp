// SPDX-License-Identifier: Apache-2.0
#include "sim/vision/embree_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/color.h"

namespace earshot {
namespace {

struct Pictures {
  std::vector<float> depth, normals;
  std::vector<std::uint8_t> rgb;
  std::vector<std::uint16_t> semantic;

  Pictures(const CameraSensorConfig& config, const Scene& scene, const Appearance* appearance, const Pose& pose) {
    const auto pixels = static_cast<std::size_t>(config.width_px * config.height_px);
    depth.assign(pixels, -1.f);
    normals.assign(3 * pixels, -1.f);
    rgb.assign(appearance ? 3 * pixels : 0, 77);
    semantic.assign(appearance ? pixels : 0, 777);
    EmbreeCamera(config).render(scene, appearance, pose, {.depth = depth, .rgb = rgb, .semantic = semantic, .normals = normals});
  }
};

std::uint16_t number_of(const std::string& category) {
  const std::vector<std::string>& names = category_names();
  return static_cast<std::uint16_t>(std::find(names.begin(), names.end(), category) - names.begin());
}

// Packets of sixteen in blocks of pixels against packets of eight in rows.
TEST(EmbreeCamera, DepthDoesNotDependOnHowRaysArePacked) {
  const Scene scene = load_scene("house:3,rooms=3");
  const CameraConfig agent{.width_px = 64, .height_px = 48, .horizontal_fov_deg = 80.f, .height_m = 1.1f};
  for (int step = 0; step < 12; ++step) {
    const Pose pose{.position = {1.f + 0.2f * static_cast<float>(step), 0.f, 2.f}, .heading_rad = 0.6 * step};
    const CameraFrame frame = frame_of(sensor_of(agent), pose);
    const std::vector<glm::vec3> local = pixel_directions(sensor_of(agent));
    std::vector<float> expected;
    for (std::size_t first = 0; first < local.size(); first += 8) {
      std::array<glm::vec3, 8> origins, directions;
      std::array<float, 8> distances_m;
      origins.fill(frame.eye);
      for (std::size_t lane = 0; lane < 8; ++lane) {
        const glm::vec3 d = local[first + lane];
        directions[lane] = d.x * frame.right + d.y * frame.up + d.z * frame.forward;
      }
      scene.rays().intersect8(origins, directions, distances_m);
      for (std::size_t lane = 0; lane < 8; ++lane)
        expected.push_back(std::min(distances_m[lane] * local[first + lane].z / agent.max_depth_m, 1.f));
    }
    EXPECT_EQ(Pictures(sensor_of(agent), scene, nullptr, pose).depth, expected) << step;
  }
}

TEST(EmbreeCamera, ShoeboxFromInside) {
  // The middle of a 6 x 3 x 4 m room, camera 1 m up, 90 degrees: walls ahead at z = 0, 2 m away.
  const Scene scene = load_scene("shoebox:6x3x4");
  const auto appearance = load_appearance(scene);
  const CameraSensorConfig config{.width_px = 31, .height_px = 31, .up_m = 1.f};  // odd: a pixel looks along the axis
  const Pictures pictures(config, scene, appearance.get(), {.position = {3, 0, 2}});
  const std::size_t middle = 15 * 31 + 15, bottom = 30 * 31 + 15;
  EXPECT_NEAR(pictures.depth[middle], 0.2f, 1e-6f);
  EXPECT_EQ(pictures.semantic[middle], number_of("wall"));
  EXPECT_EQ(pictures.semantic[bottom], number_of("floor"));
  EXPECT_NEAR(pictures.normals[3 * middle + 2], 1.f, 1e-6f);  // toward the camera
  EXPECT_NEAR(pictures.normals[3 * bottom + 1], 1.f, 1e-6f);  // upwards
  EXPECT_NEAR(pictures.normals[3 * bottom], 0.f, 1e-6f);
  // Light on the wall, whose normal is +z, times its colour.
  const glm::vec3 lit = light_on({0, 0, 1}) * appearance->triangle_color[0];
  for (int channel = 0; channel < 3; ++channel)
    EXPECT_NEAR(pictures.rgb[3 * middle + static_cast<std::size_t>(channel)], 255.f * encode_srgb(lit[channel]),
                14.f);  // objects differ by 8 %
}

TEST(EmbreeCamera, UnlitColoursAreThoseOfTheSurface) {
  const Scene scene = load_scene("shoebox:6x3x4");
  const auto appearance = load_appearance(scene);
  const Pictures pictures({.width_px = 8, .height_px = 8, .horizontal_fov_deg = 20.f, .unlit = true}, scene, appearance.get(),
                          {.position = {3, 0, 2}});
  const Hit hit = scene.rays().intersect({3, 1.25f, 2}, {0, 0, -1});
  const auto expected = to_srgb8(appearance->triangle_color[hit.triangle]);
  for (std::size_t i = 0; i < pictures.rgb.size(); ++i) EXPECT_EQ(pictures.rgb[i], expected[i % 3]);
}

TEST(EmbreeCamera, YawAndPitchTurnTheView) {
  // 6 x 3 x 4 m, camera 1 m up in the middle: 90 degrees to the left is x = 0 (3 m), up is the ceiling (2 m), down the floor (1 m).
  const Scene scene = load_scene("shoebox:6x3x4");
  const auto middle_depth = [&](float yaw_deg, float pitch_deg, double heading_rad) {
    const CameraSensorConfig config{.width_px = 9, .height_px = 9, .up_m = 1.f, .yaw_deg = yaw_deg, .pitch_deg = pitch_deg};
    return 10.f * Pictures(config, scene, nullptr, {.position = {3, 0, 2}, .heading_rad = heading_rad}).depth[4 * 9 + 4];
  };
  EXPECT_NEAR(middle_depth(0, 0, 0), 2.f, 1e-5f);
  EXPECT_NEAR(middle_depth(90, 0, 0), 3.f, 1e-5f);
  EXPECT_NEAR(middle_depth(-45, 0, std::numbers::pi / 4), 2.f, 1e-5f);
  EXPECT_NEAR(middle_depth(0, 90, 0), 2.f, 1e-5f);
  EXPECT_NEAR(middle_depth(30, -90, 0.3), 1.f, 1e-5f);
}

TEST(EmbreeCamera, MountIsInTheAgentsDirections) {
  // Heading a quarter turn left (towards -x): 0.5 m forward is -x, 0.25 m right is -z.
  const Scene scene = load_scene("shoebox:6x3x4");
  const Pose pose{.position = {3, 0, 2}, .heading_rad = std::numbers::pi / 2};
  const auto middle_depth = [&](float yaw_deg) {
    const CameraSensorConfig config{.width_px = 9, .height_px = 9, .right_m = 0.25f, .up_m = 1.f, .forward_m = 0.5f, .yaw_deg = yaw_deg};
    return 10.f * Pictures(config, scene, nullptr, pose).depth[4 * 9 + 4];
  };
  EXPECT_NEAR(middle_depth(0), 2.5f, 1e-5f);
  EXPECT_NEAR(middle_depth(-90), 1.75f, 1e-5f);
}

TEST(EmbreeCamera, PanoramaSeesEveryWallAtItsDistanceAlongTheRay) {
  const Scene scene = load_scene("shoebox:6x3x4");
  const CameraSensorConfig config{
      .width_px = 64, .height_px = 32, .projection = Projection::equirectangular, .horizontal_fov_deg = 360.f, .up_m = 1.f};
  const glm::dvec3 eye(3, 1, 2), size(6, 3, 4);
  const Pictures pictures(config, scene, nullptr, {.position = {3, 0, 2}});
  for (int row = 0; row < 32; ++row)
    for (int column = 0; column < 64; ++column) {
      const double yaw = (column + 0.5 - 32) * 2 * std::numbers::pi / 64, pitch = (16 - row - 0.5) * 2 * std::numbers::pi / 64;
      const glm::dvec3 direction(std::cos(pitch) * std::sin(yaw), std::sin(pitch), -std::cos(pitch) * std::cos(yaw));
      double distance_m = 1e9;
      for (int axis = 0; axis < 3; ++axis)
        if (direction[axis] != 0) distance_m = std::min(distance_m, ((direction[axis] > 0 ? size[axis] : 0) - eye[axis]) / direction[axis]);
      EXPECT_NEAR(10.0 * pictures.depth[static_cast<std::size_t>(row * 64 + column)], distance_m, 1e-4) << row << " " << column;
    }
}

TEST(EmbreeCamera, NothingHitIsFarBlackAndUnknown) {
  const Scene scene("empty", TriangleMesh{}, {}, Air{});
  const Appearance appearance;
  const Pictures pictures({.width_px = 5, .height_px = 3}, scene, &appearance, {});
  for (const float depth : pictures.depth) EXPECT_EQ(depth, 1.f);
  for (const float normal : pictures.normals) EXPECT_EQ(normal, 0.f);
  for (const std::uint8_t value : pictures.rgb) EXPECT_EQ(value, 0);
  for (const std::uint16_t number : pictures.semantic) EXPECT_EQ(number, 0);
}

TEST(EmbreeCamera, RefusesBadCameras) {
  EXPECT_THROW(EmbreeCamera({.width_px = 0}), InputError);
  EXPECT_THROW(EmbreeCamera({.horizontal_fov_deg = 180.f}), InputError);
  EXPECT_THROW(EmbreeCamera({.pitch_deg = 91.f}), InputError);
  EXPECT_THROW(EmbreeCamera({.up_m = std::numeric_limits<float>::quiet_NaN()}), InputError);
  EXPECT_THROW(EmbreeCamera({.width_px = 64, .height_px = 64, .projection = Projection::equirectangular, .horizontal_fov_deg = 360.f}),
               InputError);
}

}  // namespace
}  // namespace earshot
