// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <limits>

#include "envs/batch/batched_env.h"
#include "envs/hearing/sound_library.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

EnvConfig from_text(const std::string& yaml, const std::vector<std::string>& overrides = {}) {
  EnvConfig config;
  ConfigReader reader = ConfigReader::from_text(yaml, "env.yaml", overrides);
  read(reader, config);
  reader.finish();
  validate(config);
  return config;
}

TEST(EnvConfig, DefaultsAreValid) {
  EXPECT_NO_THROW(validate(EnvConfig{}));
  EXPECT_NO_THROW(from_text(""));
}

TEST(EnvConfig, ReadsNoiseAndMap) {
  const EnvConfig config = from_text(R"(
task: {actuation_noise: {forward_m: 0.02, turn_deg: 1.5, veer_deg: 0.5}}
observation:
  pose: true
  noise: {position_m: 0.1, heading_deg: 2}
  topdown_map: true
  map: {size_px: 48, metres_per_px: 0.2, frame: allocentric, goal: true}
)");
  EXPECT_EQ(config.task.actuation_noise.forward_m, 0.02f);
  EXPECT_EQ(config.task.actuation_noise.turn_deg, 1.5f);
  EXPECT_EQ(config.task.actuation_noise.veer_deg, 0.5f);
  EXPECT_EQ(config.observation.pose_noise.position_m, 0.1f);
  EXPECT_EQ(config.observation.pose_noise.heading_deg, 2.f);
  const SensorSpec map = *find_sensor(sensor_table(config.observation, 2400), "topdown_map");
  EXPECT_EQ(map.shape, (std::vector<int>{48, 48, 4}));
  EXPECT_EQ(map.type, SensorType::uint8);
  EXPECT_EQ(config.observation.map.frame, MapFrame::allocentric);
  EXPECT_THROW(from_text("observation: {map: {size: 3}}"), InputError);
  EXPECT_THROW(from_text("task: {actuation_noise: {sigma: 3}}"), InputError);
}

TEST(EnvConfig, AMapThatIsNotDrawnHasNoKeys) {
  for (const std::string key : {"size_px: 48", "metres_per_px: 0.2", "frame: allocentric", "goal: true"}) {
    EXPECT_NO_THROW(from_text("observation: {topdown_map: true, map: {" + key + "}}"));
    try {
      static_cast<void>(from_text("observation: {map: {" + key + "}}"));
      ADD_FAILURE() << key << " was accepted";
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("observation.map." + key.substr(0, key.find(':'))));
      EXPECT_THAT(error.what(), testing::HasSubstr("has no effect without observation.topdown_map"));
    }
  }
  EXPECT_NO_THROW(from_text("observation: {map: {size_px: 64, metres_per_px: 0.125, frame: egocentric, goal: false}}"));
}

TEST(EnvConfig, ARendererHasAPictureToDrawAndADeviceThatItTakes) {
  const EnvConfig config = from_text("observation: {renderer: egl, egl_device: software}");
  EXPECT_EQ(config.observation.renderer, Renderer::egl);
  EXPECT_EQ(config.observation.egl_device, "software");
  EXPECT_EQ(from_text("observation: {renderer: auto}").observation.renderer, Renderer::automatic);
  EXPECT_EQ(EnvConfig{}.observation.renderer, Renderer::embree);
  EXPECT_THROW(from_text("observation: {renderer: vulkan}"), InputError);
  EXPECT_THROW(from_text("observation: {renderer: egl, depth: false}"), InputError);
  EXPECT_THROW(from_text("observation: {renderer: auto, egl_device: software}"), InputError);
  EXPECT_THROW(from_text("observation: {egl_device: software}"), InputError);
}

TEST(EnvConfig, ReadsEveryPart) {
  const EnvConfig config = from_text(R"(
task: {max_steps: 77}
observation:
  pointgoal: true
  camera: {width_px: 64, height_px: 32}
  rgb: true
  cameras: {around: {normals: true, projection: equirectangular, horizontal_fov_deg: 360, width_px: 48, height_px: 24}}
acoustics: {rays: 20, early_order: 1}
navmesh: {agent_radius_m: 0.2}
order: once
threads: 3
seed: 18446744073709551615
sound_gain: 2.5
scene_cache_gb: 0.5
prefetch: false
field_store: some/folder
field_store_gb: 2.5
scene_store: some/scenes
scene_store_gb: 1.5
quarantine_dir: some/other
)",
                                     {"task.forward_m=0.25"});
  EXPECT_EQ(config.task.max_steps, 77);
  EXPECT_EQ(config.task.forward_m, 0.25f);
  const std::vector<SensorSpec> sensors = sensor_table(config.observation, 2400);
  EXPECT_EQ(find_sensor(sensors, "depth")->shape, (std::vector<int>{32, 64, 1}));
  EXPECT_EQ(find_sensor(sensors, "spectrogram")->shape, (std::vector<int>{65, 26, 2}));
  EXPECT_EQ(find_sensor(sensors, "rgb")->type, SensorType::uint8);
  EXPECT_EQ(find_sensor(sensors, "around_normals")->shape, (std::vector<int>{24, 48, 3}));
  EXPECT_EQ(config.acoustics.rays, 20);
  EXPECT_EQ(config.navmesh.agent_radius_m, 0.2f);
  EXPECT_EQ(config.order, EpisodeOrder::once);
  EXPECT_EQ(config.threads, 3);
  EXPECT_EQ(config.seed, std::numeric_limits<std::uint64_t>::max());
  EXPECT_FALSE(config.prefetch);
  EXPECT_EQ(config.field_store, "some/folder");
  EXPECT_EQ(config.field_store_gb, 2.5);
  EXPECT_EQ(config.scene_store, "some/scenes");
  EXPECT_EQ(config.scene_store_gb, 1.5);
  EXPECT_EQ(config.quarantine_dir, "some/other");
}

TEST(EnvConfig, PresetComesBeforeItsOverrides) {
  const EnvConfig config = from_text("acoustics: {rays: 33, preset: high}");
  EXPECT_EQ(config.acoustics.rays, 33);
  EXPECT_EQ(config.acoustics.rir_length_s, acoustic_preset("high").rir_length_s);
  EXPECT_THROW(from_text("acoustics: {preset: highest}"), InputError);
}

TEST(EnvConfig, SpectrogramFollowsTheRate) {
  const EnvConfig config = from_text("{acoustics: {sample_rate_hz: 44100}, task: {step_time_s: 0.25}}");
  EXPECT_EQ(config.observation.sound.num_samples, 44100);
  EXPECT_EQ(config.observation.sound.rows(), 65);
  EXPECT_EQ(config.observation.sound.columns(), 69);  // docs/reference/formats.md, section 6.3
}

TEST(EnvConfig, UnknownKeysAreErrorsAtEveryLevel) {
  for (const char* text : {"{tasks: {}}", "{task: {max_step: 1}}", "{observation: {deph: true}}", "{observation: {camera: {fov: 9}}}",
                           "{acoustics: {ray: 4}}", "{navmesh: {radius: 1}}", "{order: twice}", "{task: 3}"})
    EXPECT_THROW(from_text(text), InputError) << text;
  try {
    from_text("{observation: {camera: {width: 9}}}");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("observation.camera.width"));
  }
}

TEST(EnvConfig, ValuesOutOfRangeAreRefused) {
  const std::function<void(EnvConfig&)> changes[] = {
      [](EnvConfig& c) { c.task.step_time_s = 0.1501f; },  // 2401.6 samples
      [](EnvConfig& c) { c.task.step_time_s = 1.5f; },     // longer than the window
      [](EnvConfig& c) { c.sound_gain = 0; },
      [](EnvConfig& c) { c.sound_gain = std::numeric_limits<float>::quiet_NaN(); },
      [](EnvConfig& c) { c.crossfade_s = 0.2f; },
      [](EnvConfig& c) { c.crossfade_s = -0.1f; },
      [](EnvConfig& c) { c.threads = -1; },
      [](EnvConfig& c) { c.scene_cache_gb = -1; },
      [](EnvConfig& c) { c.field_store_gb = -1; },
      [](EnvConfig& c) { c.scene_store_gb = -1; },
      [](EnvConfig& c) { c.field_store_gb = std::numeric_limits<double>::quiet_NaN(); },
      [](EnvConfig& c) { c.scene_root = "/no/such/folder"; },
      [](EnvConfig& c) { c.sound_root = "/no/such/folder"; },
      [](EnvConfig& c) { c.acoustics.sample_rate_hz = 48000; },  // the spectrogram still says 16000
      [](EnvConfig& c) { c.observation.depth = c.observation.spectrogram = c.observation.pointgoal = false; },
      [](EnvConfig& c) { c.observation.camera.width_px = 0; },
  };
  int index = 0;
  for (const auto& change : changes) {
    EnvConfig config;
    change(config);
    EXPECT_THROW(validate(config), InputError) << "change " << index;
    ++index;
  }
}

TEST(SoundLibrary, NamesAreResolvedUnderTheRootFirst) {
  EXPECT_EQ(resolve_sound("synth:alarm:2", "/somewhere"), "synth:alarm:2");
  EXPECT_EQ(resolve_sound("nowhere/none.wav", "/somewhere"), "nowhere/none.wav");

  const auto root = std::filesystem::temp_directory_path() / ("earshot_sounds_" + std::to_string(::getpid()));
  std::filesystem::create_directories(root);
  const std::vector<float> samples = {0.f, 0.25f, -0.5f, 0.125f};
  write_wav(root / "my_ring.wav", samples, 1, 16000);
  EXPECT_EQ(resolve_sound("my_ring", root.string()), (root / "my_ring.wav").string());
  EXPECT_EQ(resolve_sound("my_ring.wav", root.string()), (root / "my_ring.wav").string());
  EXPECT_EQ(resolve_sound((root / "my_ring").string(), ""), (root / "my_ring.wav").string());

  Episode episode;
  episode.sound = "my_ring";
  const SoundLibrary sounds(std::span(&episode, 1), root.string(), 16000, 2.f);
  EXPECT_EQ(sounds.sound("my_ring").clip.samples, (std::vector<float>{0.f, 0.5f, -1.f, 0.25f}));
  episode.sound = "other";
  EXPECT_THROW(SoundLibrary(std::span(&episode, 1), root.string(), 16000, 1.f), InputError);
  std::filesystem::remove_all(root);
}

}  // namespace
}  // namespace earshot
