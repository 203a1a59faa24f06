// SPDX-License-Identifier: Apache-2.0
#include "envs/config/env_config.h"

#include <cmath>
#include <filesystem>

#include "envs/config/channel_order.h"
#include "envs/scenes/scene_cache.h"
#include "envs/task/episode.h"
#include "sim/acoustics/accuracy/accuracy_plan.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// Returns whether the order of harmonics is given.
bool read_acoustics(ConfigReader& reader, EnvConfig& config) {
  ConfigReader acoustics = reader.child("acoustics", "Simulation of responses: a preset, and keys over it.");
  if (!config.accuracy.empty())
    for (const std::string_view key : keys_of_accuracy())
      if (acoustics.has(std::string(key))) acoustics.fail(std::string(key), "is a key that env.accuracy chooses; set only one of them");
  std::string preset;
  acoustics.read("preset", preset, Allowed::text("fast, balanced or high"),
                 "Preset that the other keys start from: fast (training), balanced or high (reference). Empty: fast.");
  if (!preset.empty()) config.acoustics = acoustic_preset(preset);
  read(acoustics, config.acoustics);
  acoustics.finish();
  return acoustics.has("sh_order");
}

void read_stores(ConfigReader& reader, EnvConfig& config) {
  reader.read("scene_root", config.scene_root, Allowed::text("a folder"), "Folder of relative scene files.");
  reader.read("scene_cache_gb", config.scene_cache_gb, Allowed::at_least(0), "Memory for loaded scenes, of each process.");
  reader.read("prefetch", config.prefetch, "Loads the scene and source of an environment's next episode in the background.");
  reader.read("field_store", config.field_store, Allowed::text("a folder"),
              "Folder of source fields that all processes and runs share. Empty: folder fields of a run, otherwise in memory only.");
  reader.read("field_store_gb", config.field_store_gb, Allowed::between(0, 1e9),
              "Size of field_store; the least recently used fields are removed first.");
  reader.read("scene_store", config.scene_store, Allowed::text("a folder"),
              "Folder of preprocessed scenes that all processes and runs share. Empty: each process loads them.");
  reader.read("scene_store_gb", config.scene_store_gb, Allowed::between(0, 1e9),
              "Size of scene_store; the least recently used scenes are removed first.");
  reader.read(
      "quarantine_dir", config.quarantine_dir, Allowed::text("a folder"),
      "Folder for files of quarantined episodes, which earshot replay runs again. Empty: folder quarantine of a run, otherwise none.");
}

}  // namespace

void read(ConfigReader& reader, EnvConfig& config) {
  ConfigReader task = reader.child("task", "Rules of an episode: actions, rewards and its end.");
  read(task, config.task);
  task.finish();
  reader.read("accuracy", config.accuracy, Allowed::text("errors, for example t20=10%,drr=2dB"),
              "Errors that responses may have; a planner chooses the cheapest acoustics within them. Empty: acoustics decides.");
  const bool has_order = read_acoustics(reader, config);
  ConfigReader observation = reader.child("observation", "Sensors of the agents.");
  read(observation, config.observation);
  observation.finish();
  if (!has_order) raise_order_to_channels(config);
  // The analysed window is one second of what is rendered (docs/reference/conventions.md, section 6).
  config.observation.sound.sample_rate_hz = config.acoustics.sample_rate_hz;
  config.observation.sound.num_samples = static_cast<int>(std::lround(config.acoustics.sample_rate_hz));
  ConfigReader navmesh = reader.child("navmesh", "Walkable surface and the agent's cylinder.");
  read(navmesh, config.navmesh);
  navmesh.finish();

  reader.read("hrtf", config.hrtf, Allowed::text("a SOFA file"),
              "SOFA file with HRTFs, for observation.channels binaural. Empty: a rigid sphere of radius 8.75 cm.");
  reader.read("sound_root", config.sound_root, Allowed::text("a folder"), "Folder of sounds that an episode set names without a path.");
  reader.read("sound_gain", config.sound_gain, Allowed::above(0),
              "Factor on the dry sound. 12.566371 (4 pi) makes a source as loud at 1 m as its dry clip.");
  reader.read("crossfade_s", config.crossfade_s, Allowed::at_least(0),
              "Duration of the fade from one response to the next; at most task.step_time_s.");
  reader.read("sound_restarts", config.sound_restarts,
              "Restarts the sounds at every step, without the reverberation of the steps before; for comparison.");
  reader.read("agents", config.agents, Allowed::between(1, static_cast<double>(kMaxAgents)), "Agents in each environment.");
  reader.read_choice<EpisodeOrder>("order", config.order, {{"random", EpisodeOrder::random}, {"once", EpisodeOrder::once}},
                                   "Order of episodes. random: drawn without end. once: each of the set once.");
  reader.read_choice<Autoreset>(
      "autoreset", config.autoreset, {{"same_step", Autoreset::same_step}, {"next_step", Autoreset::next_step}, {"off", Autoreset::off}},
      "Start of the next episode. same_step: in the step that ends one. next_step: in the step after. off: by reset() only.");
  reader.read("threads", config.threads, Allowed::between(0, 1024), "Threads of the batch. 0: all cores.");
  reader.read("stage_limit_s", config.stage_limit_s, Allowed::between(0, 1e6),
              "Time after which a stage of an environment is given up and its episode quarantined. 0: no limit.");
  reader.read("seed", config.seed, "Seed of episodes and noise; in a run config the default is the seed of the run.");
  read_stores(reader, config);
}

std::string config_text(const EnvConfig& config) {
  ConfigReader recorder = ConfigReader::recorder();
  EnvConfig copy = config;
  read(recorder, copy);
  return recorder.effective();
}

void validate(const EnvConfig& config) {
  check_values(config, "");
  validate(config.task);
  validate(config.observation);
  validate(config.acoustics);
  if (!config.accuracy.empty()) {
    static_cast<void>(AccuracyTarget::parse(config.accuracy));
    require(config.observation.hears(), "accuracy", config.accuracy, "has no effect without a sound sensor");
  }
  validate(config.navmesh);
  require(config.hrtf.empty() || config.observation.has_ears(), "hrtf", config.hrtf,
          "has no effect unless observation.channels is binaural");
  const float rate_hz = config.acoustics.sample_rate_hz;
  require(config.observation.sound.sample_rate_hz == rate_hz, "observation.sound.sample_rate_hz", config.observation.sound.sample_rate_hz,
          "must equal acoustics.sample_rate_hz: the spectrogram is computed from the rendered sound");
  const double block = static_cast<double>(rate_hz) * static_cast<double>(config.task.step_time_s);
  require(std::abs(block - std::round(block)) < 1e-3 && block >= 1, "task.step_time_s", config.task.step_time_s,
          "must be a whole number of samples at acoustics.sample_rate_hz: sound and motion share one clock");
  require(std::lround(block) <= config.observation.sound.num_samples, "task.step_time_s", config.task.step_time_s,
          "must not exceed the analysis window of the sound (1 s)");
  require(config.crossfade_s <= config.task.step_time_s, "crossfade_s", config.crossfade_s,
          "must be in [0, task.step_time_s]: a fade ends within its step");
  require(config.agents == 1 || config.observation.renderer == Renderer::embree, "observation.renderer",
          config.observation.renderer == Renderer::egl ? "egl" : "auto",
          "must be embree with several agents: other renderers do not draw agents");
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
