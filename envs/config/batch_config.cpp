// SPDX-License-Identifier: Apache-2.0
#include "envs/config/batch_config.h"

#include <utility>

#include "envs/config/env_accuracy.h"
#include "envs/config/episode_maker.h"
#include "envs/config/field_choice.h"
#include "envs/scenes/scene_cache.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

constexpr About kDataAbout("Episodes of the run.");
constexpr About kTrainAbout("Episodes for training.");
constexpr About kEvalAbout("Episodes for evaluation, which training does not see.");
constexpr About kHeldOutAbout("Episodes for evaluations while the run trains (held_out), in other scenes than train and eval.");
constexpr About kEpisodesAbout("Episodes of the environments: scenes and sounds, or a file.");

template <class Config>
void read_section(ConfigReader& parent, const char* key, Config& config, About about) {
  ConfigReader section = parent.child(key, about);
  read(section, config);
  section.finish();
}

/// The keys of a section that must name something to walk in.
void read_episodes(ConfigReader& reader, DataConfig& data) {
  read(reader, data);
  reader.finish();
  if (data.scenes.empty() && data.file.empty()) reader.fail("scenes", "is missing; give at least one scene, or a `file` of episodes");
  if (!data.scenes.empty() && data.sounds.empty())
    reader.fail("sounds", "is missing; give at least one sound, for example synth:telephone");
}

}  // namespace

void read_env_section(ConfigReader& run, EnvConfig& env) {
  read_section(run, "env", env, "Environments: task, sensors, acoustics and where files are.");
}

void read_data_section(ConfigReader& run, DataConfig& train, DataConfig& eval, DataConfig& held_out) {
  ConfigReader data = run.child("data", kDataAbout);
  read_section(data, "train", train, kTrainAbout);
  read_section(data, "eval", eval, kEvalAbout);
  read_section(data, "held_out", held_out, kHeldOutAbout);
  data.finish();
}

std::vector<ConfigKey> env_config_keys() {
  ConfigReader describer = ConfigReader::describer();
  EnvConfig env;
  DataConfig episodes;
  read(describer, env);
  ConfigReader section = describer.child("episodes", kEpisodesAbout);
  read(section, episodes);
  return describer.described();
}

DataConfig training_data() {
  DataConfig data;
  data.goals_per_scene = 10;
  return data;
}

BatchParts read_batch(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides,
                      const std::vector<std::string>& env_overrides, const std::string& split, std::shared_ptr<const EpisodeSet> episodes) {
  const bool in_run = ConfigReader::from_text(yaml, where).has("env");
  std::vector<std::string> all = overrides;
  for (const std::string& text : env_overrides) all.push_back(in_run ? "env." + text : text);
  ConfigReader reader = ConfigReader::from_text(yaml, where, all);
  BatchParts parts;
  DataConfig keys;
  if (in_run) {
    if (split == "train") keys = training_data();
    reader.read("seed", parts.config.seed, "Seed of the run.");
    read_env_section(reader, parts.config);
    if (!episodes) {
      ConfigReader data = reader.child("data", kDataAbout);
      if (!data.has(split)) data.fail(split, "is missing; it describes the episodes");
      ConfigReader section = data.child(split, split == "train" ? kTrainAbout : split == "eval" ? kEvalAbout : kHeldOutAbout);
      read_episodes(section, keys);
    }
  } else {
    if (!episodes && !reader.has("episodes")) reader.fail("episodes", "is missing; give `scenes` and `sounds`, or a `file` of episodes");
    ConfigReader section = reader.child("episodes", kEpisodesAbout);
    if (!episodes) read_episodes(section, keys);
    read(reader, parts.config);
    reader.finish();
    if (parts.config.agents > 1 && !section.has("agents")) keys.agents.count = parts.config.agents;
  }
  validate(parts.config);

  const std::shared_ptr<SceneCache> first = make_scene_cache(parts.config);
  parts.set = std::move(episodes);
  if (!parts.set)
    parts.set = std::make_shared<const EpisodeSet>(keys.scenes.empty() ? load_episode_set(keys.file)
                                                                       : make_episodes(keys, parts.config.task, first));
  EnvConfig& config = parts.config;
  bool replanned = false;
  if (!config.accuracy.empty()) {
    config = plan_env_accuracy(config, *parts.set).config;
    replanned = true;
  } else if (config.acoustics.field == Switch::automatic && config.observation.hears()) {
    config.acoustics.field = choose_field(config.acoustics, *parts.set, 0).on ? Switch::on : Switch::off;
    replanned = true;
  }
  parts.scenes = replanned ? make_scene_cache(config) : first;
  return parts;
}

}  // namespace earshot
