// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/episode_walk.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <vector>

#include "envs/hearing/sound_library.h"
#include "envs/scenes/scene_cache.h"
#include "envs/task/goal_silence.h"
#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"

namespace earshot {

std::shared_ptr<const Scene> load_scene_under(const std::string& scene_id, const std::string& scene_root) {
  const FlushDenormals flush;
  return std::make_shared<const Scene>(load_scene(resolve_scene(scene_id, scene_root)));
}

WalkedScene load_walked_scene(const std::string& scene_id, const EnvConfig& config) {
  const FlushDenormals flush;
  std::shared_ptr<const Scene> scene = load_scene_under(scene_id, config.scene_root);
  Navmesh navmesh(scene->mesh(), config.navmesh);
  return {std::move(scene), std::move(navmesh)};
}

WalkOutcome walk_episode(const EnvConfig& config, const WalkedScene& scene, const GeodesicField& goal_field, const Episode& episode,
                         std::span<const std::int8_t> actions, std::uint32_t stream, std::uint32_t episode_count) {
  EARSHOT_EXPECT(config.agents == 1);
  const FlushDenormals flush;
  const TaskConfig& task = config.task;
  std::vector<GeodesicField> other_goals;
  for (const glm::dvec3 other : episode.other_goals) other_goals.emplace_back(scene.navmesh, scene.scene->to_local(other));
  NearestGoal goal(goal_field);
  for (const GeodesicField& other : other_goals) goal.add(other);

  const auto start = scene.navmesh.snap(scene.scene->to_local(episode.start_position));
  if (!start) return {.metrics = {}, .fault = "its start is off the walkable surface"};
  const auto distance_m = goal.distance_m(*start);
  if (!distance_m || !std::isfinite(*distance_m)) return {.metrics = {}, .fault = "no walkable path leads from its start to its goal"};
  const double heading_rad = heading_of(episode.start_rotation);
  const int oracle_actions = std::max(1, count_oracle_actions(task, scene.navmesh, goal, *start, heading_rad).value_or(episode.num_action));
  std::function<double(const std::string&)> clip_length_s;
  if (config.observation.hears())
    clip_length_s = [&](const std::string& name) {
      const SoundClip clip = open_sound(resolve_sound(name, config.sound_root), config.acoustics.sample_rate_hz);
      return static_cast<double>(clip.samples.size()) / static_cast<double>(clip.sample_rate_hz);
    };

  AvNavState state;
  state.begin(task, goal, *start, heading_rad, oracle_actions, goal_silent_from_s(episode, clip_length_s));
  for (std::size_t step = 0; step < actions.size(); ++step) {
    if (state.terminated() || state.truncated())
      return {.metrics = state.metrics(task),
              .fault = fmt::format("has {} actions after its end at step {}{}", actions.size() - step, step,
                                   state.terminated() ? ", a stop" : "")};
    const auto action = static_cast<Action>(actions[step]);
    ActuationError error;
    if (task.actuation_noise.any())
      error = draw_actuation_error(
          task.actuation_noise, action,
          RandomStream(config.seed, Purpose::actuation_noise, stream, episode_count, static_cast<std::uint32_t>(state.steps())));
    state.step(task, scene.navmesh, goal, action, error);
    if (state.lost_distances() > 0)
      return {.metrics = state.metrics(task), .fault = fmt::format("has no distance to its goal at step {}", step + 1)};
  }
  if (!state.terminated() && !state.truncated())
    return {.metrics = state.metrics(task),
            .fault = fmt::format("ends without a stop after {} of {} allowed actions", actions.size(), task.max_steps)};
  return {.metrics = state.metrics(task)};
}

}  // namespace earshot
