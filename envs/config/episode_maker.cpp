// SPDX-License-Identifier: Apache-2.0
#include "envs/config/episode_maker.h"

#include <algorithm>
#include <utility>

#include "envs/episodes/name_ranges.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

/// At least so many places of a scene are drawn for distractors.
constexpr int kDistractorPlaces = 10;

}  // namespace

EpisodeMaker::EpisodeMaker(const DataConfig& data, const TaskConfig& task, std::shared_ptr<SceneCache> scenes)
    : data_(data), task_(task), sounds_(expand_sounds(data.sounds)), agents_(data.agents), scenes_(std::move(scenes)) {
  if (sounds_.empty()) throw InputError("data.sounds", "is empty", "give at least one sound, for example synth:telephone");
  agents_.sounds = expand_sounds(agents_.sounds);
}

std::vector<Episode> EpisodeMaker::make(const std::string& name) {
  const auto scene = scenes_->scene(name);
  const EpisodeRequest request{.task = task_,
                               .filter = data_.filter,
                               .sounds = sounds_,
                               .count = data_.episodes_per_scene,
                               .seed = data_.seed,
                               .num_goals = data_.goals_per_scene};
  auto episodes = generate_episodes(name, *scene->scene, scene->navmesh, request);
  if (data_.scenario.changes_episodes()) {
    // Distractors use the positions of goals, so that data computed once per source serves both.
    std::vector<glm::dvec3> places;
    if (data_.scenario.distractors > 0) {
      EpisodeRequest distractor_request = request;
      distractor_request.num_goals = std::max(data_.goals_per_scene, kDistractorPlaces);
      for (const glm::vec3 place : spread_goals(name, *scene->scene, scene->navmesh, distractor_request))
        places.push_back(scene->scene->to_world(place));
    }
    apply_scenario(data_.scenario, sounds_, places, data_.seed, episodes);
  }
  apply_agents(agents_, *scene->scene, scene->navmesh, request, episodes);
  return episodes;
}

EpisodeSet make_episodes(const DataConfig& data, const TaskConfig& task, std::shared_ptr<SceneCache> scenes,
                         const std::function<void(std::size_t done)>& progress) {
  EpisodeMaker maker(data, task, std::move(scenes));
  EpisodeSet set;
  std::size_t done = 0;
  for (const std::string& scene : expand_ranges(data.scenes)) {
    for (Episode& episode : maker.make(scene)) {
      episode.episode_id = std::to_string(set.episodes.size());
      set.episodes.push_back(std::move(episode));
    }
    if (progress) progress(++done);
  }
  set.hash = episode_set_hash(set.episodes);
  return set;
}

}  // namespace earshot
