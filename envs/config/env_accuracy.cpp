// SPDX-License-Identifier: Apache-2.0
#include "envs/config/env_accuracy.h"

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "envs/scenes/scene_cache.h"
#include "envs/task/av_nav_task.h"
#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxScenes = 3;

using Goal = std::array<double, 3>;
Goal goal_of(const Episode& episode) { return {episode.goal_position.x, episode.goal_position.y, episode.goal_position.z}; }

/// Indices of the first episode of each scene, in the order of the set.
std::vector<std::size_t> one_per_scene(const EpisodeSet& set) {
  std::map<std::string, std::size_t> first;
  for (std::size_t i = 0; i < set.episodes.size(); ++i) first.emplace(set.episodes[i].scene_id, i);
  std::vector<std::size_t> all;
  for (const auto& [scene, episode] : first) all.push_back(episode);
  std::ranges::sort(all);
  return all;
}

/// Where the oracle hears on its way, ears of the agent, start and goal included.
std::vector<glm::vec3> places_on_the_way(const TaskConfig& task, const Episode& episode, const EnvSource& source) {
  const EnvScene& scene = *source.scene;
  const glm::vec3 ears(0, task.ear_height_m, 0);
  TaskConfig unhurried = task;
  unhurried.max_steps = 4 * task.max_steps;  // as the count of an episode's actions
  AvNavState state;
  state.begin(unhurried, source.field, scene.scene->to_local(episode.start_position), heading_of(episode.start_rotation), 1);
  std::vector<glm::vec3> places = {state.pose(unhurried).position + ears};
  while (!state.terminated() && !state.truncated()) {
    state.step(unhurried, scene.navmesh, source.field, oracle_action(unhurried, source.field, state.pose(unhurried)));
    const glm::vec3 place = state.pose(unhurried).position + ears;
    if (place != places.back()) places.push_back(place);
  }
  return places;
}

/// Responses that share a source, in the mean over the goals of the set.
double poses_per_source(const EpisodeSet& set) {
  std::map<std::pair<std::string, Goal>, int> goals;
  double steps = 0;
  for (const Episode& episode : set.episodes) {
    goals[{episode.scene_id, goal_of(episode)}]++;
    steps += std::max(episode.num_action, kStepsPerEpisode);
  }
  return steps / static_cast<double>(goals.size());
}

}  // namespace

EnvAccuracy plan_env_accuracy(const EnvConfig& config, const EpisodeSet& set, const std::function<void(double fraction)>& progress) {
  AccuracyRequest request;
  request.config = config.acoustics;
  request.target = AccuracyTarget::parse(config.accuracy);
  request.poses = poses_per_source(set);
  EnvConfig plain = config;
  plain.accuracy.clear();
  plain.acoustics.field = Switch::off;  // places and goals are asked of the cache, not sound
  const std::shared_ptr<SceneCache> cache = make_scene_cache(plain);
  const std::vector<std::size_t> scenes = one_per_scene(set);
  const std::size_t count = std::min(scenes.size(), kMaxScenes);
  for (std::size_t i = 0; i < count; ++i) {
    const Episode& episode = set.episodes[scenes[count == 1 ? 0 : i * (scenes.size() - 1) / (count - 1)]];
    const auto source = cache->source(episode.scene_id, episode.goal_position, config.task.source_height_m);
    request.sites.push_back({.scene = source->scene->scene,
                             .source = source->scene->scene->to_local(episode.goal_position) + glm::vec3(0, config.task.source_height_m, 0),
                             .places = places_on_the_way(config.task, episode, *source)});
  }
  EnvAccuracy result{.config = config, .plan = plan_accuracy(request, progress), .scenes = static_cast<int>(count)};
  result.config.accuracy.clear();
  result.config.acoustics = result.plan.choice().config;
  return result;
}

}  // namespace earshot
