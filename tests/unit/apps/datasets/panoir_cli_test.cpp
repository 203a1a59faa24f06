// SPDX-License-Identifier: Apache-2.0
// configs/datasets/panoir.yaml as a user runs it: shapes, angles and coordinates against computations of the test.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "datasets/rir_corpus_config.h"
#include "tests/support/programs/dataset_cli.h"

namespace earshot {
namespace {

constexpr int kViews = 18, kWidth = 1152, kHeight = 384, kColumns = kWidth / kViews;
constexpr double kRadian = std::numbers::pi / 180;

std::string config_path() { return (source_dir() / "configs/datasets/panoir.yaml").string(); }

struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint16_t> values;
};

Picture read_grey16(const std::string& bytes) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_memory(&image, bytes.data(), bytes.size()) == 0) return {};
  image.format = PNG_FORMAT_LINEAR_Y;
  Picture picture{static_cast<int>(image.width), static_cast<int>(image.height), {}};
  picture.values.resize(static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height));
  png_image_finish_read(&image, nullptr, picture.values.data(), 0, nullptr);
  return picture;
}

/// Millimetres along the axis of a pinhole view of an empty box, from an eye in it.
double depth_in_box_mm(const std::array<double, 3>& size, const std::array<double, 3>& eye, double heading_deg, int column, int row) {
  const int view = column / kColumns;
  // The first view begins half a turn to the left of the heading.
  const double axis = (heading_deg + 180 - 20.0 * view - 10) * kRadian;
  const double pixel = 2 * std::tan(10 * kRadian) / kColumns;  // square pixels on a plane at distance 1
  const double right = (column % kColumns + 0.5 - kColumns / 2.0) * pixel, up = (kHeight / 2.0 - row - 0.5) * pixel;
  const std::array<double, 3> forward{-std::sin(axis), 0, -std::cos(axis)}, side{std::cos(axis), 0, -std::sin(axis)};
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t a = 0; a < 3; ++a) {
    const double direction = forward[a] + right * side[a] + (a == 1 ? up : 0);
    if (direction > 0) nearest = std::min(nearest, (size[a] - eye[a]) / direction);
    if (direction < 0) nearest = std::min(nearest, -eye[a] / direction);
  }
  return 1000 * nearest;  // the direction has length 1 along the axis
}

class PanoIrCli : public DatasetCli {
 protected:
  PanoIrCli() : DatasetCli("panoir_cli") {}
};

TEST(PanoIrConfig, HasTheNumbersOfThePaper) {
  const RirCorpusConfig config = load_rir_corpus_config(config_path(), {});
  const std::vector<float> height{1.5f, 1.5f};
  EXPECT_EQ(config.source_height_m, height);
  EXPECT_EQ(config.listener_height_m, height);
  EXPECT_EQ(config.max_distance_m, 5);
  EXPECT_EQ(config.max_height_difference_m, 2);
  EXPECT_EQ(config.channels, "mono");
  EXPECT_EQ(config.panorama->width_px, 1152);
  EXPECT_EQ(config.panorama->height_px, 384);
  EXPECT_EQ(config.panorama->views, 18);
  AcousticConfig high = acoustic_preset("high");
  high.sample_rate_hz = 44100;
  high.rir_length_s = 1;
  RirCorpusConfig other = config;
  other.acoustics = high;
  other.acoustics.sh_order = config.acoustics.sh_order;
  EXPECT_EQ(config_text(other), config_text(config));
}

// Twelve places in boxes that the test draws; acoustics of few rays, as it looks at pictures and labels.
TEST_F(PanoIrCli, ViewsAndLabelsAreThoseOfTheRoom) {
  const std::vector<std::array<double, 3>> boxes{{6, 3, 4}, {3.5, 2.6, 7.2}, {9.1, 3.4, 8.3}, {4.4, 2.2, 3.9}};
  std::string scenes;
  for (const auto& [x, y, z] : boxes) scenes += fmt::format("{}\"shoebox:{}x{}x{}@0.3\"", scenes.empty() ? "" : ", ", x, y, z);
  const Outcome outcome = dataset("rir " + config_path() + " --out " + path("set") + " --threads 2 --set 'scenes=[" + scenes +
                                  "]' --set sources_per_room=3 --set acoustics.rays=16 --set acoustics.source_rays=0"
                                  " --set acoustics.rir_length_s=0.1");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.text;
  const auto pairs = lines("set/manifest.jsonl");
  ASSERT_EQ(pairs.size(), 12u);
  for (const auto& pair : pairs) {
    const auto file = [&](const char* key) { return read_file(folder_.path() / "set" / pair[key].get<std::string>()); };
    const auto wav = corpus_cases::read_float_wav(file("file"));
    EXPECT_EQ(wav.channels.size(), 1u);
    EXPECT_EQ(pair["num_samples"], 4410);
    const Picture depth = read_grey16(file("depth_file"));
    ASSERT_EQ(depth.width, kWidth);
    ASSERT_EQ(depth.height, kHeight);

    const auto at = pair["listener"]["position_m"].get<std::array<double, 3>>(),
               from = pair["source"]["position_m"].get<std::array<double, 3>>();
    const double heading_deg = pair["listener"]["heading_deg"];
    const auto& box = boxes[pair["room"].get<std::size_t>()];
    double worst_mm = 0;
    for (int row = 0; row < kHeight; row += 7)
      for (int column = 0; column < kWidth; ++column)
        worst_mm = std::max(worst_mm, std::abs(depth.values[static_cast<std::size_t>(row * kWidth + column)] -
                                               depth_in_box_mm(box, at, heading_deg, column, row)));
    // Half a millimetre of rounding, and directions of 32-bit floats; a view that is turned by a pixel is off by tens.
    EXPECT_LT(worst_mm, 1.5);

    // Polar coordinates: counter-clockwise from the heading, where -z is heading 0 and -x is heading 90.
    const double dx = from[0] - at[0], dy = from[1] - at[1], dz = from[2] - at[2], distance_m = std::hypot(dx, dy, dz);
    EXPECT_NEAR(pair["distance_m"].get<double>(), distance_m, 1e-4);
    EXPECT_LE(distance_m, 5);
    EXPECT_NEAR(at[1], 1.5, 1e-4);
    EXPECT_NEAR(from[1], 1.5, 1e-4);
    const double azimuth_deg = std::atan2(-dx, -dz) / kRadian - heading_deg;
    EXPECT_NEAR(std::remainder(pair["azimuth_deg"].get<double>() - azimuth_deg, 360), 0, 0.01);
    EXPECT_NEAR(pair["elevation_deg"].get<double>(), 0, 0.01);
  }
  const auto corpus = nlohmann::json::parse(read_file(folder_.path() / "set/corpus.json"));
  EXPECT_THAT(corpus["config"].get<std::string>(), testing::HasSubstr("views: 18"));

  const std::string begin = "rir " + config_path() + " --out " + path("refused") + " --set ";
  for (const char* views : {"1", "2", "7", "5"}) expect_refused(dataset(begin + "panorama.views=" + views), "panorama.views", "refused");
  expect_refused(dataset(begin + "panorama.views=-1"), "panorama.views", "refused");
  expect_refused(dataset(begin + "panorama.views=361"), "panorama.views", "refused");
  expect_refused(dataset(begin + "max_height_difference_m=0"), "max_height_difference_m", "refused");
}

// A house of two storeys would pair places on both; a box on stilts does not, so the bound is tested by heights.
TEST_F(PanoIrCli, HeightsDifferByLessThanTheBound) {
  const Outcome outcome = dataset("rir " + config_path() + " --out " + path("set") + " --threads 2 --set 'scenes=[shoebox:6x6x5@0.3]'" +
                                  " --set sources_per_room=40 --set 'source_height_m=[0.5,5]' --set 'listener_height_m=[0.5,5]'"
                                  " --set max_height_difference_m=0.7 --set acoustics.rays=16 --set acoustics.source_rays=0"
                                  " --set acoustics.rir_length_s=0.05 --set panorama.width_px=36 --set panorama.height_px=12");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.text;
  double largest = 0;
  for (const auto& pair : lines("set/manifest.jsonl"))
    largest = std::max(largest, std::abs(pair["source"]["position_m"][1].get<double>() - pair["listener"]["position_m"][1].get<double>()));
  EXPECT_LE(largest, 0.7 + 1e-5);
  EXPECT_GT(largest, 0.35);  // the bound is not twice as narrow: of 40 pairs some lie in the upper half
}

}  // namespace
}  // namespace earshot
