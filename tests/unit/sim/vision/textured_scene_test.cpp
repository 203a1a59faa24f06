// SPDX-License-Identifier: Apache-2.0
// From a texture in a file to the colour of a pixel.
#include <gtest/gtest.h>
#include <turbojpeg.h>

#include <cmath>
#include <memory>
#include <vector>

#include "sim/base/files.h"
#include "sim/scene/color.h"
#include "sim/vision/embree_camera.h"
#include "sim/vision/png_file.h"
#include "tests/support/files/gltf_files.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

/// A wall of 2 x 2 m at z = -1, seen from the origin of its middle; its texture beside it.
std::string write_wall(const TempFolder& folder, const std::string& texture, const nlohmann::json& sampler = {},
                       const std::vector<float>& uvs = {0, 1, 1, 1, 1, 0, 0, 0}) {
  GltfWriter writer;
  const std::size_t positions = writer.add_positions({-1, -1, -1, 1, -1, -1, 1, 1, -1, -1, 1, -1});
  const std::size_t coordinates = writer.add_accessor(writer.add_view(uvs), 4, 5126, "VEC2");
  const std::size_t indices = writer.add_accessor(writer.add_view(std::vector<std::uint16_t>{0, 1, 2, 0, 2, 3}), 6, 5123, "SCALAR");
  writer.json["meshes"].push_back(
      {{"primitives", {{{"attributes", {{"POSITION", positions}, {"TEXCOORD_0", coordinates}}}, {"indices", indices}, {"material", 0}}}}});
  writer.json["materials"] = {{{"name", "wall"}, {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}};
  writer.json["textures"] = {{{"source", 0}}};
  if (!sampler.is_null()) {
    writer.json["samplers"] = nlohmann::json::array({sampler});
    writer.json["textures"][0]["sampler"] = 0;
  }
  writer.json["images"] = {{{"uri", texture}}};
  writer.json["nodes"].push_back({{"mesh", 0}});
  return folder.write("wall.gltf", writer.gltf());
}

/// What a camera of size^2 pixels sees of the wall, which fills its picture.
std::vector<std::uint8_t> photograph(const std::string& file, int size) {
  const Scene scene = load_scene(file);
  const auto appearance = load_appearance(scene);
  std::vector<std::uint8_t> rgb(3 * static_cast<std::size_t>(size * size));
  EmbreeCamera({.width_px = size, .height_px = size, .up_m = 0.f, .unlit = true}).render(scene, appearance.get(), {}, {.rgb = rgb});
  return rgb;
}

std::vector<std::uint8_t> checks(int size) {
  std::vector<std::uint8_t> rgb;
  for (int row = 0; row < size; ++row)
    for (int column = 0; column < size; ++column)
      for (const int value : {20 + 30 * row, 240 - 25 * column, (row * 7 + column * 13) % 5 * 60})
        rgb.push_back(static_cast<std::uint8_t>(value));
  return rgb;
}

TEST(TexturedScene, PixelsOverTexelCentresHaveTheirColours) {
  // 7 x 7 texels on a wall that fills 7 x 7 pixels: each looks at the centre of a texel, where bilinear sampling gives the texel itself.
  const TempFolder folder;
  write_png_rgb(folder / "t.png", 7, 7, checks(7));
  const std::vector<std::uint8_t> seen = photograph(write_wall(folder, "t.png"), 7), expected = checks(7);
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(seen[i], expected[i], 1) << i;
}

TEST(TexturedScene, BetweenTexelsTheLightIsMixed) {
  // Black and white side by side: half way the mean of the light, which is 188 encoded, not 128.
  const TempFolder folder;
  write_png_rgb(folder / "t.png", 2, 1, std::vector<std::uint8_t>{0, 0, 0, 255, 255, 255});
  const std::vector<std::uint8_t> seen = photograph(write_wall(folder, "t.png", {{"wrapS", 33071}}), 9);
  EXPECT_NEAR(seen[3 * (4 * 9 + 4)], 188, 1);
  EXPECT_EQ(seen[3 * (4 * 9)], 0);  // clamped at the ends
  EXPECT_EQ(seen[3 * (4 * 9 + 8)], 255);
}

TEST(TexturedScene, WrapsAsTheSamplerSays) {
  // Two copies side by side: repeated black, white, black, white; mirrored black, white, white, black.
  const TempFolder folder;
  write_png_rgb(folder / "t.png", 2, 1, std::vector<std::uint8_t>{0, 0, 0, 255, 255, 255});
  const std::vector<float> twice{0, 1, 2, 1, 2, 0, 0, 0};
  const auto middle_row = [&](int wrap) {
    const std::vector<std::uint8_t> seen = photograph(write_wall(folder, "t.png", {{"wrapS", wrap}}, twice), 4);
    return std::vector<int>{seen[3 * 4], seen[3 * 5], seen[3 * 6], seen[3 * 7]};
  };
  EXPECT_EQ(middle_row(10497), (std::vector<int>{0, 255, 0, 255}));
  EXPECT_EQ(middle_row(33648), (std::vector<int>{0, 255, 255, 0}));
}

TEST(TexturedScene, ReadsJpegs) {
  const TempFolder folder;
  const std::vector<std::uint8_t> grey(3 * 16 * 16, 128);
  const std::unique_ptr<void, decltype(&tjDestroy)> writer(tjInitCompress(), tjDestroy);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  ASSERT_EQ(tjCompress2(writer.get(), grey.data(), 16, 0, 16, TJPF_RGB, &bytes, &size, TJSAMP_444, 95, 0), 0);
  folder.write("t.jpg", std::string_view(reinterpret_cast<const char*>(bytes), size));
  tjFree(bytes);
  for (const std::uint8_t value : photograph(write_wall(folder, "t.jpg"), 5)) EXPECT_NEAR(value, 128, 2);  // JPEG is lossy
}

TEST(TexturedScene, LargeTexturesAreHalvedWithTheirLight) {
  std::vector<std::uint8_t> rgb;
  for (int i = 0; i < 64 * 64; ++i) rgb.insert(rgb.end(), 3, i % 2 ? 255 : 0);
  const TempFolder folder;
  write_png_rgb(folder / "t.png", 64, 64, rgb);
  const Texture texture = decode_texture(read_file(folder / "t.png"), "t.png", 16);
  EXPECT_EQ(texture.width_px, 16);
  EXPECT_EQ(texture.height_px, 16);
  for (const std::uint8_t value : texture.rgb) EXPECT_NEAR(value, 188, 1);
}

TEST(TexturedScene, VertexColoursAreInterpolated) {
  const TempFolder folder;
  GltfWriter writer;
  const std::size_t positions = writer.add_positions({-1, -1, -1, 3, -1, -1, -1, 3, -1});
  const std::size_t colors = writer.add_accessor(writer.add_view(std::vector<float>{0, 0, 0, 1, 0, 0, 0, 1, 0}), 3, 5126, "VEC3");
  writer.json["meshes"].push_back({{"primitives", {{{"attributes", {{"POSITION", positions}, {"COLOR_0", colors}}}}}}});
  writer.json["nodes"].push_back({{"mesh", 0}});
  const std::vector<std::uint8_t> seen = photograph(folder.write("a.gltf", writer.gltf()), 8);
  for (int row = 0; row < 8; ++row)
    for (int column = 0; column < 8; ++column) {
      const float red = (static_cast<float>(column) + 0.5f) / 16, green = (7.5f - static_cast<float>(row)) / 16;  // of the 4 m
      const std::size_t at = 3 * static_cast<std::size_t>(row * 8 + column);
      EXPECT_NEAR(seen[at], 255 * encode_srgb(red), 1);
      EXPECT_NEAR(seen[at + 1], 255 * encode_srgb(green), 1);
      EXPECT_EQ(seen[at + 2], 0);
    }
}

TEST(TexturedScene, RealRoomWithABakedTexture) {
  SKIP_WITHOUT_DATA("scenes/cube-room/cube-room.gltf");
  const Scene scene = load_scene((data_folder() / "scenes/cube-room/cube-room.gltf").string());
  const auto appearance = load_appearance(scene);
  ASSERT_TRUE(appearance->detail);
  EXPECT_EQ(appearance->detail->mesh.textures.size(), 1u);
  EXPECT_LE(appearance->detail->mesh.textures[0].width_px, 1024);
}

}  // namespace
}  // namespace earshot
