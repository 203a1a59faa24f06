#include "python/src/batch_config.h"

#include <algorithm>
#include <utility>

#include "envs/config/env_accuracy.h"
#include "envs/config/field_choice.h"
#include "envs/episodes/agent_scenario.h"
#include "envs/episodes/episode_generator.h"
#include "envs/episodes/name_ranges.h"
#include "envs/episodes/sound_scenario.h"
#include "envs/scenes/scene_cache.h"
#include "sim/base/config_reader.h"
#include "sim/base/errors.h"

namespace earshot::python {
namespace {

/// At least so many places of a scene are drawn for distractors, as for a training.
constexpr int kDistractorPlaces = 10;

struct EpisodeKeys {
  std::string file;
  std::vector<std::string> scenes, sounds;
  int episodes_per_scene = 50, goals_per_scene = 0;
  std::uint64_t seed = 0;
  EpisodeFilter filter;
  SoundScenario scenario;
  AgentScenario agents;
};

void read(ConfigReader& reader, EpisodeKeys& keys) {
  reader.read("file", keys.file);
  reader.read("scenes", keys.scenes);
  reader.read("sounds", keys.sounds);
  reader.read("episodes_per_scene", keys.episodes_per_scene);
  reader.read("goals_per_scene", keys.goals_per_scene);
  reader.read("seed", keys.seed);
  ConfigReader filter = reader.child("filter");
  read(filter, keys.filter);
  filter.finish();
  validate(keys.filter);
  ConfigReader scenario = reader.child("scenario");
  read(scenario, keys.scenario);
  scenario.finish();
  validate(keys.scenario);
  ConfigReader agents = reader.child("agents");
  read(agents, keys.agents);
  agents.finish();
  validate(keys.agents);
  reader.finish();
  require(keys.episodes_per_scene > 0, reader.prefix() + "episodes_per_scene", keys.episodes_per_scene, "must be positive");
  require(keys.goals_per_scene >= 0 && keys.goals_per_scene <= 100'000, reader.prefix() + "goals_per_scene", keys.goals_per_scene,
          "must be in [0, 100000]; 0 gives every episode a goal of its own");
  if (keys.scenes.empty() && keys.file.empty()) reader.fail("scenes", "is missing; name at least one SCENE, or a `file` of episodes");
  if (!keys.scenes.empty() && keys.sounds.empty()) reader.fail("sounds", "is missing; name at least one, for example synth:telephone");
}

/// Episodes of one scene.
std::vector<Episode> generate(const EpisodeKeys& keys, const std::vector<std::string>& sounds, const TaskConfig& task,
                              const std::string& spec, const EnvScene& scene) {
  std::vector<Episode> episodes = generate_episodes(spec, *scene.scene, scene.navmesh, task, keys.filter, sounds, keys.episodes_per_scene,
                                                    keys.seed, keys.goals_per_scene);
  if (keys.scenario.changes_episodes()) {
    std::vector<glm::dvec3> places;
    if (keys.scenario.distractors > 0)
      for (const glm::vec3 place :
           spread_goals(spec, *scene.scene, scene.navmesh, task, keys.filter, std::max(keys.goals_per_scene, kDistractorPlaces), keys.seed))
        places.push_back(scene.scene->to_world(place));
    apply_scenario(keys.scenario, sounds, places, keys.seed, episodes);
  }
  AgentScenario agents = keys.agents;
  agents.sounds = expand_sounds(agents.sounds);
  apply_agents(agents, *scene.scene, scene.navmesh, task, keys.filter, keys.seed, episodes);
  return episodes;
}

EpisodeSet episodes_of(const EpisodeKeys& keys, const TaskConfig& task, SceneCache& cache) {
  if (keys.scenes.empty()) return load_episode_set(keys.file);
  const std::vector<std::string> sounds = expand_sounds(keys.sounds);
  EpisodeSet set;
  for (const std::string& range : keys.scenes)
    for (const std::string& spec : expand_range(range))
      for (Episode& episode : generate(keys, sounds, task, spec, *cache.scene(spec))) {
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
  EpisodeKeys keys;
  if (in_run) {
    keys.goals_per_scene = split == "train" ? 10 : 0;  // the defaults of a run config
    reader.read("seed", parts.config.seed);
    ConfigReader env = reader.child("env");
    read(env, parts.config);
    env.finish();
    ConfigReader data = reader.child("data");
    if (!data.has(split)) data.fail(split, "is missing; it names the episodes");
    ConfigReader section = data.child(split);
    read(section, keys);
  } else {
    if (!reader.has("episodes")) reader.fail("episodes", "is missing; it names scenes and sounds, or a file of episodes");
    ConfigReader section = reader.child("episodes");
    read(section, keys);
    read(reader, parts.config);
    reader.finish();
    if (parts.config.agents > 1 && !section.has("agents")) keys.agents.count = parts.config.agents;
  }
  validate(parts.config);

  const std::shared_ptr<SceneCache> first = make_scene_cache(parts.config);
  parts.set = std::make_shared<const EpisodeSet>(episodes_of(keys, parts.config.task, *first));
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
