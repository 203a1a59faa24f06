// SPDX-License-Identifier: Apache-2.0
// Sound, pictures, walks and configs of the public headers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "earshot/audio.h"
#include "earshot/camera.h"
#include "earshot/config.h"
#include "earshot/navigation.h"
#include "earshot/version.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/base/random.h"
#include "sim/base/version.h"
#include "sim/nav/navmesh.h"
#include "sim/scene/appearance.h"
#include "sim/scene/scene.h"
#include "sim/vision/embree_camera.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;

TEST(ApiAudio, ConvolutionIsTheSumOverTheSamples) {
  const RandomStream random(5, Purpose::episode, 1);
  api::Audio dry{1, 16000, std::vector<float>(700)};
  api::Rir rir{2, 300, 16000, std::vector<float>(600)};
  for (std::uint32_t i = 0; i < 700; ++i) dry.samples[i] = random.uniform(i) - 0.5f;
  for (std::uint32_t i = 0; i < 600; ++i) rir.samples[i] = random.uniform(1000 + i) - 0.5f;
  const api::Audio heard = api::convolve(dry, rir);
  ASSERT_EQ(heard.num_frames(), 999u);
  for (int channel = 0; channel < 2; ++channel)
    for (std::size_t n = 0; n < 999; n += 37) {
      double sum = 0;
      for (std::size_t k = 0; k <= n && k < 700; ++k)
        if (n - k < 300) sum += static_cast<double>(dry.samples[k]) * static_cast<double>(rir.channel(channel)[n - k]);
      EXPECT_NEAR(heard.channel(channel)[n], sum, 1e-4);  // rounding of the transforms: 1e-6 of a peak of 10
    }
}

TEST(ApiAudio, FilesKeepTheSamples) {
  const TempFolder folder;
  const api::Audio dry = api::load_sound("synth:speech:3", 22050);
  EXPECT_EQ(dry.num_channels, 1);
  EXPECT_EQ(dry.sample_rate_hz, 22050);
  api::write_wav(folder / "dry.wav", dry);
  EXPECT_EQ(api::load_audio(folder / "dry.wav").samples, dry.samples);
  EXPECT_EQ(api::load_sound(folder / "dry.wav", 22050).samples, dry.samples);
}

TEST(ApiAudio, WrongInputIsRefused) {
  EXPECT_THAT(message_of<InputError>([] { (void)api::load_sound("synth:hum", 16000); }), HasSubstr("hum"));
  EXPECT_THAT(message_of<InputError>([] { (void)api::load_audio("no_such.wav"); }), HasSubstr("no_such.wav"));
  EXPECT_THAT(message_of<InputError>([] { (void)api::convolve({2, 16000, {0, 0}}, {1, 1, 16000, {1}}); }), HasSubstr("2 channels"));
  EXPECT_THAT(message_of<InputError>([] { (void)api::convolve({1, 8000, {0}}, {1, 1, 16000, {1}}); }), HasSubstr("8000 Hz"));
}

TEST(ApiCamera, PicturesAreThoseOfTheEngine) {
  const api::Scene scene("house:7", {.preset = "fast"});
  const api::Camera camera(scene, {.width_px = 48, .height_px = 40, .fov_deg = 70, .height_m = 1.4, .pitch_deg = -10, .max_depth_m = 8});
  const Scene engine = load_scene("house:7");
  const auto appearance = load_appearance(engine);
  const EmbreeCamera expected_camera(
      CameraSensorConfig{.width_px = 48, .height_px = 40, .horizontal_fov_deg = 70, .up_m = 1.4f, .pitch_deg = -10, .max_depth_m = 8});
  const api::Vec3 foot = api::Navigation(scene).random_point(3);
  const api::Pictures seen = camera.render(foot, 25, {.depth = true, .rgb = true, .semantic = true, .normals = true});
  std::vector<float> depth(48 * 40), normals(3 * 48 * 40);
  std::vector<std::uint8_t> rgb(3 * 48 * 40);
  std::vector<std::uint16_t> semantic(48 * 40);
  const Pose pose{.position = engine.to_local({foot.x, foot.y, foot.z}), .heading_rad = 25 * std::numbers::pi / 180};
  expected_camera.render(engine, appearance.get(), pose, {.depth = depth, .rgb = rgb, .semantic = semantic, .normals = normals});
  EXPECT_EQ(seen.depth, depth);
  EXPECT_EQ(seen.rgb, rgb);
  EXPECT_EQ(seen.semantic, semantic);
  EXPECT_EQ(seen.normals, normals);
  EXPECT_TRUE(camera.render(foot).rgb.empty());
}

TEST(ApiCamera, WrongInputIsRefused) {
  const api::Scene scene("shoebox:5x3x4@0.2", {.preset = "fast"});
  EXPECT_THAT(message_of<InputError>([&] { api::Camera(scene, {.fov_deg = 200}); }), HasSubstr("200"));
  EXPECT_THAT(message_of<InputError>([&] { api::Camera(scene, {.width_px = 0}); }), HasSubstr("width_px"));
  const api::Camera camera(scene);
  EXPECT_THAT(message_of<InputError>([&] { (void)camera.render({NAN, 0, 1}); }), HasSubstr("foot"));
  const TempFolder folder;
  EXPECT_THAT(message_of<InputError>([&] { api::write_rgb_png(folder / "a.png", camera.render({1, 0, 1})); }), HasSubstr("colours"));
}

TEST(ApiNavigation, PathsHaveTheirLengthAndStepsShortenThem) {
  const api::Scene scene("house:7", {.preset = "fast"});
  const api::Navigation floor(scene);
  const Scene engine_scene = load_scene("house:7");
  const Navmesh engine(engine_scene.mesh(), NavmeshConfig{});
  EXPECT_EQ(floor.area_m2(), static_cast<double>(engine.main_area_m2()));
  for (std::uint32_t pair = 0; pair < 12; ++pair) {
    const api::Vec3 from = floor.random_point(9, 2 * pair), to = floor.random_point(9, 2 * pair + 1);
    const auto length_m = floor.distance_m(from, to);
    ASSERT_TRUE(length_m.has_value());
    const auto path = floor.path(from, to);
    ASSERT_GE(path.size(), 2u);
    double sum_m = 0;
    for (std::size_t i = 1; i < path.size(); ++i) sum_m += std::hypot(path[i].x - path[i - 1].x, path[i].z - path[i - 1].z);
    EXPECT_NEAR(sum_m, *length_m, 0.02 + 0.01 * *length_m);  // corners stand off walls by a millimetre; Detour's own search is of cells
    EXPECT_GE(*length_m + 1e-4, std::hypot(to.x - from.x, to.z - from.z));
    EXPECT_NEAR(std::hypot(path.back().x - to.x, path.back().z - to.z), 0, 0.01);
  }
}

TEST(ApiNavigation, WallsStopAMoveAndPlacesOffTheFloorAreRefused) {
  const api::Scene scene("shoebox:5x3x4@0.2", {.preset = "fast"});
  const api::Navigation floor(scene);
  EXPECT_NEAR(floor.move({2.5, 0, 2}, {0.5, 0, 0}).position.x, 3, 0.01);
  EXPECT_FALSE(floor.move({2.5, 0, 2}, {0.5, 0, 0}).collided);
  EXPECT_TRUE(floor.move({2.5, 0, 2}, {9, 0, 0}).collided);
  EXPECT_FALSE(floor.snap({20, 0, 2}).has_value());
  EXPECT_THAT(message_of<InputError>([&] { (void)floor.move({20, 0, 2}, {1, 0, 0}); }), HasSubstr("walkable"));
  EXPECT_THAT(message_of<InputError>([&] { api::Navigation(scene, {.agent_radius_m = -1}); }), HasSubstr("agent_radius_m"));
  EXPECT_TRUE(floor.path({1, 0, 1}, {50, 0, 1}).empty());
}

TEST(ApiConfig, SettingsAreTextsThatReadBackToTheSameNumbers) {
  const api::Settings settings{{"a", true}, {"b", false},  {"c", 1 << 20},
                               {"d", 0.1},  {"e", "text"}, {"f", std::uint64_t{18446744073709551615u}}};
  EXPECT_EQ(settings.texts(), (std::vector<std::string>{"a=on", "b=off", "c=1048576", "d=0.1", "e=text", "f=18446744073709551615"}));
  const RandomStream random(5, Purpose::episode, 2);
  for (std::uint32_t i = 0; i < 200; ++i) {
    const double number =
        (static_cast<double>(random.uniform(2 * i)) - 0.5) * std::pow(10., 40. * static_cast<double>(random.uniform(2 * i + 1)) - 20);
    EXPECT_EQ(std::stod(api::Settings::Value(number).text()), number);
  }
}

TEST(ApiConfig, EveryAcousticKeyIsInTheText) {
  const std::string text = api::acoustic_config_text("fast", {{"rays", 333}, {"diffraction", false}});
  EXPECT_THAT(text, HasSubstr("rays: 333"));
  AcousticConfig config;
  ConfigReader reader = ConfigReader::from_text(text, "text");
  read(reader, config);
  reader.finish();
  EXPECT_EQ(config.rays, 333);
  EXPECT_EQ(config.diffraction, Switch::off);
  EXPECT_THAT(message_of<InputError>([] { (void)api::acoustic_config_text("fast", {{"rys", 1}}); }), HasSubstr("rys"));
  EXPECT_THAT(message_of<InputError>([] { (void)api::Config::from_file("no_such.yaml"); }), HasSubstr("no_such.yaml"));
}

TEST(ApiVersion, IsThatOfTheProject) {
  EXPECT_EQ(api::version(), kVersion);
  EXPECT_FALSE(api::build_info().ray_tracer_version.empty());
  EXPECT_FALSE(api::compiler().empty());
}

}  // namespace
}  // namespace earshot
