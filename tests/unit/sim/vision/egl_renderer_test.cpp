// SPDX-License-Identifier: Apache-2.0
// On Mesa's rasterizer, which every machine has that scripts/setup.sh prepared, or on EARSHOT_TEST_EGL_DEVICE.
#include "sim/vision/egl_renderer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "sim/base/errors.h"
#include "sim/vision/egl_device.h"
#include "sim/vision/png_file.h"
#include "tests/support/envs/camera_agreement.h"
#include "tests/support/envs/tested_egl_device.h"
#include "tests/support/files/gltf_files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using camera_agreement::Album;
using camera_agreement::Stage;

/// One context for all tests of a process: making one takes longer than a test.
EglRenderer& tested() {
  static EglRenderer renderer({.device = tested_egl_device()});
  return renderer;
}

/// A closed room with a picture on its walls, as glTF: each wall shows the texture twice.
std::string write_textured_room(const TempFolder& folder) {
  std::vector<std::uint8_t> rgb;
  for (int row = 0; row < 48; ++row)
    for (int column = 0; column < 64; ++column)
      for (const int value : {(row / 8 + column / 8) % 2 * 150 + 40, 4 * column, 5 * row}) rgb.push_back(static_cast<std::uint8_t>(value));
  write_png_rgb(folder / "walls.png", 64, 48, rgb);
  GltfWriter writer;
  std::vector<float> xyz, uv;
  std::vector<std::uint16_t> corners;
  const auto add_wall = [&](glm::vec3 origin, glm::vec3 along, glm::vec3 up) {
    const auto first = static_cast<std::uint16_t>(xyz.size() / 3);
    for (const glm::vec2 at : {glm::vec2(0, 0), glm::vec2(1, 0), glm::vec2(1, 1), glm::vec2(0, 1)}) {
      const glm::vec3 p = origin + at.x * along + at.y * up;
      xyz.insert(xyz.end(), {p.x, p.y, p.z});
      uv.insert(uv.end(), {2 * at.x, 1 - at.y});
    }
    for (const int corner : {0, 1, 2, 0, 2, 3}) corners.push_back(static_cast<std::uint16_t>(first + corner));
  };
  const glm::vec3 x(5, 0, 0), y(0, 3, 0), z(0, 0, 4);
  for (const glm::vec3 origin : {glm::vec3(0), z}) add_wall(origin, x, y);
  for (const glm::vec3 origin : {glm::vec3(0), x}) add_wall(origin, z, y);
  for (const glm::vec3 origin : {glm::vec3(0), y}) add_wall(origin, x, z);
  const std::size_t positions = writer.add_positions(xyz), uvs = writer.add_accessor(writer.add_view(uv), uv.size() / 2, 5126, "VEC2");
  const std::size_t indices = writer.add_accessor(writer.add_view(corners), corners.size(), 5123, "SCALAR");
  writer.json["meshes"].push_back(
      {{"primitives", {{{"attributes", {{"POSITION", positions}, {"TEXCOORD_0", uvs}}}, {"indices", indices}, {"material", 0}}}}});
  writer.json["materials"] = {
      {{"name", "wall"}, {"pbrMetallicRoughness", {{"baseColorFactor", {0.9, 0.8, 0.7, 1.0}}, {"baseColorTexture", {{"index", 0}}}}}}};
  writer.json["textures"] = {{{"source", 0}}};
  writer.json["images"] = {{{"uri", "walls.png"}}};
  writer.json["nodes"].push_back({{"mesh", 0}});
  return folder.write("room.gltf", writer.gltf());
}

/// Ten views of each scene, 99.9 % of the pixels of each sensor: what is left is rounding on edges.
void expect_agreement(const std::string& spec, bool unlit = false) {
  const Stage stage = camera_agreement::load_stage(spec);
  const CameraSensorConfig config{.width_px = 80, .height_px = 60, .pitch_deg = -8.f, .max_depth_m = 50.f, .unlit = unlit};
  const std::vector<Pose> poses = camera_agreement::find_poses(*stage.scene, 10, 1.25f, 3);
  ASSERT_EQ(poses.size(), 10u);
  const camera_agreement::Shares shares = camera_agreement::agreement(tested(), stage, config, poses);
  EXPECT_GE(shares.depth, 0.999);
  EXPECT_GE(shares.rgb, 0.999);
  EXPECT_GE(shares.semantic, 0.999);
  EXPECT_GE(shares.normals, 0.999);
  fmt::print("  {}: depth {:.5f} rgb {:.5f} semantic {:.5f} normals {:.5f}\n", spec.substr(spec.rfind('/') + 1), shares.depth, shares.rgb,
             shares.semantic, shares.normals);
}

TEST(EglAgreement, Shoebox) { expect_agreement("shoebox:6x3x4"); }
TEST(EglAgreement, House) { expect_agreement("house:1,rooms=4"); }
TEST(EglAgreement, HouseInDetail) { expect_agreement("house:7,rooms=3,detail_m=0.2"); }
TEST(EglAgreement, Floor) { expect_agreement("floor:2"); }
TEST(EglAgreement, TexturedRoom) {
  const TempFolder folder;
  expect_agreement(write_textured_room(folder));
  expect_agreement(write_textured_room(folder), true);
}
TEST(EglAgreement, MeasuredHouse) {
  SKIP_WITHOUT_DATA("scenes/small_house.glb");
  expect_agreement((data_folder() / "scenes/small_house.glb").string());
}
TEST(EglAgreement, RoomWithABakedTexture) {
  SKIP_WITHOUT_DATA("scenes/cube-room/cube-room.gltf");
  expect_agreement((data_folder() / "scenes/cube-room/cube-room.gltf").string());
}

TEST(EglRenderer, SoftwareIsKnownByItsExtensionAndItsName) {
  if (tested_egl_device() != "software") GTEST_SKIP() << "another device is tested";
  EXPECT_TRUE(tested().software());
  EXPECT_TRUE(is_software_renderer(tested().device_name())) << tested().device_name();
  EXPECT_TRUE(is_software_renderer("llvmpipe (LLVM 15.0.6, 256 bits)"));
  EXPECT_FALSE(is_software_renderer("NVIDIA H200/PCIe/SSE2"));
  bool any_pixel = false;
  for (const EglDevice& device : list_egl_devices()) any_pixel = any_pixel || device.software;
  EXPECT_TRUE(any_pixel);
}

TEST(EglRenderer, DevicesAreChosenByNumberAndUnknownOnesRefused) {
  for (const EglDevice& device : list_egl_devices()) {
    if (device.index < 0 || device.renderer.empty()) continue;
    EXPECT_EQ(EglRenderer({.device = std::to_string(device.index)}).device_name(), device.renderer);
  }
  for (const char* device : {"99", "cuda:77", "GPU-00000000-0000-0000-0000-000000000000", "best", ""})
    EXPECT_THAT(message_of<InputError>([&] { EglRenderer({.device = device}); }), testing::HasSubstr("earshot doctor")) << device;
}

TEST(EglRenderer, AutoNeverTakesSoftware) {
  bool hardware = false;
  for (const EglDevice& device : list_egl_devices()) hardware = hardware || (!device.software && !device.renderer.empty());
  if (hardware)
    EXPECT_FALSE(EglRenderer({.device = "auto"}).software());
  else
    EXPECT_THROW(EglRenderer({.device = "auto"}), InputError);
}

TEST(EglRenderer, ABatchIsItsViewsOneByOneBitForBit) {
  // More views than fit into one row of the target, of two scenes, that ask for different sensors.
  const Stage a = camera_agreement::load_stage("shoebox:6x3x4"), b = camera_agreement::load_stage("house:4,rooms=2");
  const CameraSensorConfig config{.width_px = 600, .height_px = 40};
  std::vector<Album> together, alone;
  std::vector<EglView> views;
  constexpr int count = 30;
  for (int i = 0; i < count; ++i) {
    together.emplace_back(config);
    alone.emplace_back(config);
  }
  for (int i = 0; i < count; ++i) {
    const Stage& stage = i % 3 ? a : b;
    const Pose pose{.position = {2.f + 0.05f * static_cast<float>(i), 0, 2}, .heading_rad = 0.4 * i};
    CameraImages wanted = together[i].images(), same = alone[i].images();
    if (i % 4 == 1) wanted.rgb = same.rgb = {};
    if (i % 4 == 2) wanted.depth = same.depth = {};
    views.push_back({stage.scene, stage.appearance, pose, wanted});
    const EglView single{stage.scene, stage.appearance, pose, same};
    tested().render(config, {&single, 1});
  }
  tested().render(config, views);
  for (int i = 0; i < count; ++i) {
    EXPECT_EQ(together[i].depth, alone[i].depth) << i;
    EXPECT_EQ(together[i].rgb, alone[i].rgb) << i;
    EXPECT_EQ(together[i].semantic, alone[i].semantic) << i;
    EXPECT_EQ(together[i].normals, alone[i].normals) << i;
  }
}

TEST(EglRenderer, ScenesAreUploadedOnceAndDroppedWithTheirScene) {
  EglRenderer renderer({.device = tested_egl_device()});
  const CameraSensorConfig config{.width_px = 16, .height_px = 16};
  Album album(config);
  for (int load = 0; load < 3; ++load) {
    const Stage stage = camera_agreement::load_stage(fmt::format("shoebox:{}x3x4", 5 + load));
    for (int i = 0; i < 4; ++i) {
      const EglView view{stage.scene, stage.appearance, {.position = {2, 0, 2}}, album.images()};
      renderer.render(config, {&view, 1});
      EXPECT_EQ(renderer.scenes_uploaded(), static_cast<std::uint64_t>(load + 1));
    }
    EXPECT_NEAR(album.depth[8 * 16 + 8], 0.2f, 1e-4f);
  }
}

TEST(EglRenderer, DepthNeedsNoAppearance) {
  const auto scene = std::make_shared<const Scene>(load_scene("shoebox:6x3x4"));
  const CameraSensorConfig config{.width_px = 16, .height_px = 16};
  Album album(config);
  const EglView view{scene, nullptr, {.position = {3, 0, 2}}, {.depth = album.depth, .normals = album.normals}};
  tested().render(config, {&view, 1});
  EXPECT_NEAR(album.depth[8 * 16 + 8], 0.2f, 1e-4f);
  EXPECT_NEAR(album.normals[3 * (8 * 16 + 8) + 2], 1.f, 1e-5f);
}

TEST(EglRenderer, ALostContextIsReportedAndThePicturesComeAllTheSame) {
  std::vector<std::string> messages;
  EglRenderer renderer({.device = tested_egl_device(), .warn = [&](const std::string& message) { messages.push_back(message); }});
  const Stage stage = camera_agreement::load_stage("shoebox:6x3x4");
  const CameraSensorConfig config{.width_px = 32, .height_px = 24};
  Album before(config), after(config);
  const EglView first{stage.scene, stage.appearance, {.position = {3, 0, 2}}, before.images()};
  renderer.render(config, {&first, 1});
  renderer.lose_context();
  const EglView second{stage.scene, stage.appearance, {.position = {3, 0, 2}}, after.images()};
  renderer.render(config, {&second, 1});
  EXPECT_EQ(before.rgb, after.rgb);
  EXPECT_EQ(before.depth, after.depth);
  EXPECT_EQ(renderer.contexts_lost(), 1u);
  EXPECT_EQ(renderer.scenes_uploaded(), 2u);
  ASSERT_EQ(messages.size(), 1u);
  EXPECT_THAT(messages[0], testing::HasSubstr("lost its context"));
}

TEST(EglRenderer, AnyThreadMayAsk) {
  const Stage stage = camera_agreement::load_stage("shoebox:6x3x4");
  const CameraSensorConfig config{.width_px = 32, .height_px = 24};
  std::vector<Album> albums(4, Album(config));
  std::vector<std::thread> threads;
  for (Album& album : albums)
    threads.emplace_back([&] {
      for (int i = 0; i < 5; ++i) {
        const EglView view{stage.scene, stage.appearance, {.position = {3, 0, 2}}, album.images()};
        tested().render(config, {&view, 1});
      }
    });
  for (std::thread& thread : threads) thread.join();
  for (const Album& album : albums) EXPECT_EQ(album.rgb, albums[0].rgb);
}

TEST(EglRenderer, RefusesPanoramas) {
  const Stage stage = camera_agreement::load_stage("shoebox:6x3x4");
  const CameraSensorConfig config{.width_px = 32, .height_px = 16, .projection = Projection::equirectangular, .horizontal_fov_deg = 360.f};
  Album album(config);
  const EglView view{stage.scene, stage.appearance, {}, album.images()};
  EXPECT_THAT(message_of<InputError>([&] { tested().render(config, {&view, 1}); }), testing::HasSubstr("embree"));
}

}  // namespace
}  // namespace earshot
