// SPDX-License-Identifier: Apache-2.0
#include "earshot/episodes.h"

#include <nlohmann/json.hpp>
#include <numbers>

#include "api/convert.h"
#include "api/episode_set_model.h"
#include "envs/config/data_config.h"
#include "envs/config/env_config.h"
#include "envs/config/episode_maker.h"
#include "sim/base/text/config_reader.h"
#include "sim/base/text/json.h"

namespace earshot::api {
namespace {

/// The keys of a data section that `options` stand for.
DataConfig data_config(const EpisodeOptions& options) {
  const nlohmann::ordered_json keys{{"scenes", options.scenes},
                                    {"sounds", options.sounds},
                                    {"episodes_per_scene", options.episodes_per_scene},
                                    {"goals_per_scene", options.goals_per_scene},
                                    {"seed", options.seed}};
  ConfigReader reader = ConfigReader::from_text(json_text(keys), "episodes", options.settings.texts());
  DataConfig data;
  read(reader, data);
  reader.finish();
  require(!data.scenes.empty(), "scenes", "[]", "must name at least one SCENE, for example house:7");
  require(!data.sounds.empty(), "sounds", "[]", "must name at least one sound, for example synth:telephone");
  return data;
}

}  // namespace

EpisodeSet EpisodeSet::load(const std::filesystem::path& path) {
  return EpisodeSet(std::make_shared<const Model>(Model{std::make_shared<const earshot::EpisodeSet>(load_episode_set(path))}));
}

EpisodeSet EpisodeSet::generate(const EpisodeOptions& options) {
  const DataConfig data = data_config(options);
  EnvConfig env;
  ConfigReader task = ConfigReader::from_text("", "task", options.task.texts());
  read(task, env.task);
  task.finish();
  validate(env);
  earshot::EpisodeSet set = make_episodes(data, env.task, make_scene_cache(env));
  return EpisodeSet(std::make_shared<const Model>(Model{std::make_shared<const earshot::EpisodeSet>(std::move(set))}));
}

void EpisodeSet::save(const std::filesystem::path& path) const { save_episode_set(*model_->set, path); }
std::size_t EpisodeSet::size() const { return model_->set->episodes.size(); }
std::uint64_t EpisodeSet::hash() const { return model_->set->hash; }

Episode EpisodeSet::operator[](std::size_t index) const {
  const earshot::Episode& episode = model_->set->episodes.at(index);
  return {.id = episode.episode_id,
          .scene = episode.scene_id,
          .sound = episode.sound,
          .start = vec3_of(episode.start_position),
          .goal = vec3_of(episode.goal_position),
          .start_heading_deg = heading_of(episode.start_rotation) * 180 / std::numbers::pi,
          .distance_m = static_cast<double>(episode.geodesic_distance_m),
          .oracle_actions = episode.num_action};
}

}  // namespace earshot::api
