#include "python/src/batch_config.h"

#include <utility>

#include "envs/config/data_config.h"
#include "envs/config/env_accuracy.h"
#include "envs/config/episode_maker.h"
#include "envs/config/field_choice.h"
#include "envs/episodes/name_ranges.h"
#include "envs/scenes/scene_cache.h"
#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot::python {
namespace {

/// The keys of a section that must name something to walk in.
void read_episodes(ConfigReader& reader, DataConfig& data) {
  read(reader, data);
  reader.finish();
  if (data.scenes.empty() && data.file.empty()) reader.fail("scenes", "is missing; name at least one SCENE, or a `file` of episodes");
  if (!data.scenes.empty() && data.sounds.empty()) reader.fail("sounds", "is missing; name at least one, for example synth:telephone");
}

EpisodeSet episodes_of(const DataConfig& data, const TaskConfig& task, const std::shared_ptr<SceneCache>& cache) {
  if (data.scenes.empty()) return load_episode_set(data.file);
  EpisodeMaker maker(data, task, cache);
  EpisodeSet set;
  for (const std::string& scene : expand_ranges(data.scenes))
    for (Episode& episode : maker.make(scene)) {
      episode.episode_id = std::to_string(set.episodes.size());
      set.episodes.push_back(std::move(episode));
    }
  set.hash = episode_set_hash(set.episodes);
  return set;
}

}  // namespace

BatchParts read_batch(const std::string& yaml, const std::string& where, const std::vector<std::string>& overrides,
                      const std::vector<std::string>& env_overrides, const std::string& split) {
  const bool in_run = ConfigReader::from_text(yaml, where).has("env");
  std::vector<std::string> all = overrides;
  for (const std::string& text : env_overrides) all.push_back(in_run ? "env." + text : text);
  ConfigReader reader = ConfigReader::from_text(yaml, where, all);
  BatchParts parts;
  DataConfig keys;
  if (in_run) {
    keys.goals_per_scene = split == "train" ? 10 : 0;  // the defaults of a run config
    reader.read("seed", parts.config.seed);
    ConfigReader env = reader.child("env");
    read(env, parts.config);
    env.finish();
    ConfigReader data = reader.child("data");
    if (!data.has(split)) data.fail(split, "is missing; it names the episodes");
    ConfigReader section = data.child(split);
    read_episodes(section, keys);
  } else {
    if (!reader.has("episodes")) reader.fail("episodes", "is missing; it names scenes and sounds, or a file of episodes");
    ConfigReader section = reader.child("episodes");
    read_episodes(section, keys);
    read(reader, parts.config);
    reader.finish();
    if (parts.config.agents > 1 && !section.has("agents")) keys.agents.count = parts.config.agents;
  }
  validate(parts.config);

  const std::shared_ptr<SceneCache> first = make_scene_cache(parts.config);
  parts.set = std::make_shared<const EpisodeSet>(episodes_of(keys, parts.config.task, first));
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

}  // namespace earshot::python
