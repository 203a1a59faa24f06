#include "envs/config/env_config.h"

#include <cmath>
#include <filesystem>

#include "envs/scenes/scene_cache.h"
#include "envs/task/episode.h"
#include "sim/acoustics/accuracy/accuracy_plan.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

void read(ConfigReader& reader, NavmeshConfig& config) {
  reader.read("agent_radius_m", config.agent_radius_m);
  reader.read("agent_height_m", config.agent_height_m);
  reader.read("max_climb_m", config.max_climb_m);
  reader.read("max_slope_deg", config.max_slope_deg);
  reader.read("cell_size_m", config.cell_size_m);
  reader.read("cell_height_m", config.cell_height_m);
  reader.read("min_region_area_m2", config.min_region_area_m2);
}

}  // namespace

void read(ConfigReader& reader, EnvConfig& config) {
  ConfigReader task = reader.child("task");
  read(task, config.task);
  task.finish();
  reader.read("accuracy", config.accuracy);
  ConfigReader acoustics = reader.child("acoustics");
  if (!config.accuracy.empty())
    for (const std::string_view key : keys_of_accuracy())
      if (acoustics.has(std::string(key))) acoustics.fail(std::string(key), "is a key that env.accuracy chooses; set only one of them");
  std::string preset;
  acoustics.read("preset", preset);
  if (!preset.empty()) config.acoustics = acoustic_preset(preset);
  read(acoustics, config.acoustics);
  acoustics.finish();
  ConfigReader observation = reader.child("observation");
  read(observation, config.observation);
  observation.finish();
  // The analysed window is one second of what is rendered (docs/reference/conventions.md, section 6).
  config.observation.sound.sample_rate_hz = config.acoustics.sample_rate_hz;
  config.observation.sound.num_samples = static_cast<int>(std::lround(config.acoustics.sample_rate_hz));
  ConfigReader navmesh = reader.child("navmesh");
  read(navmesh, config.navmesh);
  navmesh.finish();

  reader.read("hrtf", config.hrtf);
  reader.read("sound_root", config.sound_root);
  reader.read("sound_gain", config.sound_gain);
  reader.read("crossfade_s", config.crossfade_s);
  reader.read("sound_restarts", config.sound_restarts);
  reader.read("agents", config.agents);
  reader.read_choice<EpisodeOrder>("order", config.order, {{"random", EpisodeOrder::random}, {"once", EpisodeOrder::once}});
  reader.read_choice<Autoreset>("autoreset", config.autoreset,
                                {{"same_step", Autoreset::same_step}, {"next_step", Autoreset::next_step}, {"off", Autoreset::off}});
  reader.read("threads", config.threads);
  reader.read("stage_limit_s", config.stage_limit_s);
  reader.read("seed", config.seed);
  reader.read("scene_root", config.scene_root);
  reader.read("scene_cache_gb", config.scene_cache_gb);
  reader.read("prefetch", config.prefetch);
  reader.read("field_store", config.field_store);
  reader.read("field_store_gb", config.field_store_gb);
  reader.read("scene_store", config.scene_store);
  reader.read("scene_store_gb", config.scene_store_gb);
  reader.read("quarantine_dir", config.quarantine_dir);
}

std::string config_text(const EnvConfig& config) {
  ConfigReader recorder = ConfigReader::recorder();
  EnvConfig copy = config;
  read(recorder, copy);
  return recorder.effective();
}

void validate(const EnvConfig& config) {
  validate(config.task);
  validate(config.observation);
  validate(config.acoustics);
  if (!config.accuracy.empty()) {
    static_cast<void>(AccuracyTarget::parse(config.accuracy));
    require(config.observation.hears(), "accuracy", config.accuracy, "has no effect without a sound sensor");
  }
  validate(config.navmesh);
  const float rate_hz = config.acoustics.sample_rate_hz;
  require(config.observation.sound.sample_rate_hz == rate_hz, "observation.sound.sample_rate_hz", config.observation.sound.sample_rate_hz,
          "must equal acoustics.sample_rate_hz: the spectrogram is computed from the rendered sound");
  const double block = static_cast<double>(rate_hz) * static_cast<double>(config.task.step_time_s);
  require(std::abs(block - std::round(block)) < 1e-3 && block >= 1, "task.step_time_s", config.task.step_time_s,
          "must be a whole number of samples at acoustics.sample_rate_hz: sound and motion share one clock");
  require(std::lround(block) <= config.observation.sound.num_samples, "task.step_time_s", config.task.step_time_s,
          "must not exceed the analysis window of the sound (1 s)");
  require(config.sound_gain > 0 && std::isfinite(config.sound_gain), "sound_gain", config.sound_gain, "must be positive and finite");
  require(config.crossfade_s >= 0 && config.crossfade_s <= config.task.step_time_s, "crossfade_s", config.crossfade_s,
          "must be in [0, task.step_time_s]: a fade ends within its step");
  require(config.agents >= 1 && config.agents <= static_cast<int>(kMaxAgents), "agents", config.agents, "must be in [1, 16]");
  require(config.agents == 1 || config.observation.renderer == Renderer::embree, "observation.renderer",
          config.observation.renderer == Renderer::egl ? "egl" : "auto",
          "must be embree with several agents: other renderers do not draw agents");
  require(config.threads >= 0 && config.threads <= 1024, "threads", config.threads, "must be in [0, 1024]; 0: all cores");
  require(config.stage_limit_s >= 0 && config.stage_limit_s <= 1e6, "stage_limit_s", config.stage_limit_s,
          "must be in [0, 1e6] seconds; 0: no limit");
  require(config.scene_cache_gb >= 0 && std::isfinite(config.scene_cache_gb), "scene_cache_gb", config.scene_cache_gb,
          "must not be negative");
  require(config.field_store_gb >= 0 && config.field_store_gb <= 1e9, "field_store_gb", config.field_store_gb, "must be in [0, 1e9]");
  require(config.scene_store_gb >= 0 && config.scene_store_gb <= 1e9, "scene_store_gb", config.scene_store_gb, "must be in [0, 1e9]");
  require(config.scene_root.empty() || std::filesystem::is_directory(config.scene_root), "scene_root", config.scene_root,
          "must be a folder");
  require(config.sound_root.empty() || std::filesystem::is_directory(config.sound_root), "sound_root", config.sound_root,
          "must be a folder");
}

std::shared_ptr<SceneCache> make_scene_cache(const EnvConfig& config) {
  return std::make_shared<SceneCache>(
      config.acoustics, config.navmesh, config.scene_root, static_cast<std::size_t>(config.scene_cache_gb * 1e9),
      FieldStoreConfig{.folder = config.field_store,
                       .max_bytes = static_cast<std::uint64_t>(config.field_store_gb * 1e9),
                       .max_memory_bytes = 0,
                       .warn = {}},
      SceneStoreConfig{.folder = config.scene_store, .max_bytes = static_cast<std::uint64_t>(config.scene_store_gb * 1e9), .warn = {}});
}

}  // namespace earshot
