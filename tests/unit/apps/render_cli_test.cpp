// SPDX-License-Identifier: Apache-2.0
// `earshot render` writes pictures that other programs read, the same by both renderers, and refuses what it cannot draw.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "sim/base/files.h"
#include "sim/scene/texture.h"
#include "tests/support/files/test_files.h"
#include "tests/support/files/test_paths.h"

namespace earshot {
namespace {

using testing::HasSubstr;

struct RenderOutcome {
  int exit_code = -1;
  std::string text;  ///< standard output and error
};

RenderOutcome render(const std::string& arguments) {
  RenderOutcome outcome;
  FILE* output = ::popen((earshot_program().string() + " render " + arguments + " 2>&1").c_str(), "r");
  if (output == nullptr) return outcome;
  for (int c = 0; (c = std::fgetc(output)) != EOF;) outcome.text += static_cast<char>(c);
  const int status = ::pclose(output);
  outcome.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return outcome;
}

TEST(RenderCli, EverySensorBecomesAPictureOfTheSizeAskedFor) {
  const TempFolder folder;
  for (const char* sensor : {"depth", "rgb", "semantic", "normals"}) {
    const std::string file = folder / (std::string(sensor) + ".png");
    const RenderOutcome outcome = render("shoebox:6x3x4 --pose 3,0,2,0 --size 72x40 --sensor " + std::string(sensor) + " --out " + file);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.text;
    const Texture picture = decode_texture(read_file(file), file, 4096);
    EXPECT_EQ(picture.width_px, 72);
    EXPECT_EQ(picture.height_px, 40);
  }
}

TEST(RenderCli, CategoriesArePrintedWithTheirFractions) {
  const TempFolder folder;
  // Straight down from 1 m in a large room there is only the floor.
  const RenderOutcome outcome =
      render("shoebox:20x3x20 --pose 10,0,10,0 --pitch -90 --height 1 --sensor semantic --out " + (folder / "a.png"));
  EXPECT_THAT(outcome.text, testing::ContainsRegex("floor +100\\.0 %"));
}

TEST(RenderCli, BothRenderersDrawTheSame) {
  const TempFolder folder;
  const std::string scene = "house:1,rooms=3 --pose 2,0,2,30 --size 64x48 --out ";
  EXPECT_EQ(render(scene + (folder / "cast.png")).exit_code, 0);
  const RenderOutcome outcome = render(scene + (folder / "drawn.png") + " --renderer egl --device software");
  EXPECT_EQ(outcome.exit_code, 0) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("drawn by "));
  const Texture cast = decode_texture(read_file(folder / "cast.png"), "cast", 4096),
                drawn = decode_texture(read_file(folder / "drawn.png"), "drawn", 4096);
  ASSERT_EQ(cast.rgb.size(), drawn.rgb.size());
  int different = 0;
  for (std::size_t i = 0; i < cast.rgb.size(); ++i) different += std::abs(int{cast.rgb[i]} - int{drawn.rgb[i]}) > 2;
  EXPECT_LE(different, 3 * 64 * 48 / 200);  // edges
}

TEST(RenderCli, RefusesInOneLine) {
  const TempFolder folder;
  const std::string out = " --out " + (folder / "a.png");
  const auto refusal = [&](const std::string& arguments) {
    const RenderOutcome outcome = render(arguments + out);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.text;
    EXPECT_EQ(std::count(outcome.text.begin(), outcome.text.end(), '\n'), 1) << outcome.text;
    return outcome.text;
  };
  EXPECT_THAT(refusal("shoebox:6x3x4 --pose 1,2,3"), HasSubstr("--pose 1,2,3"));
  EXPECT_THAT(refusal("shoebox:6x3x4 --pose 1,2,3,nan"), HasSubstr("is not a pose"));
  EXPECT_THAT(refusal("shoebox:6x3x4 --pose 1,2,3,4 --size 64"), HasSubstr("--size 64"));
  EXPECT_THAT(refusal("shoebox:6x3x4 --pose 1,2,3,4 --size 5000x10"), HasSubstr("camera.width_px"));
  EXPECT_THAT(refusal("shoebox:6x3x4 --pose 1,2,3,4 --sensor smell"), HasSubstr("--sensor"));
  EXPECT_THAT(refusal("shoebox:6x3x4 --pose 1,2,3,4 --renderer egl --device 99"), HasSubstr("earshot doctor"));
  EXPECT_THAT(refusal("shoebox:6x3x4 --pose 1,2,3,4 --renderer egl --device software --panorama --size 64x32"), HasSubstr("embree"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a.png"));
}

}  // namespace
}  // namespace earshot
