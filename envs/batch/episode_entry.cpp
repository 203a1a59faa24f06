// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/episode_entry.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "envs/batch/fault_desk.h"
#include "envs/task/goal_silence.h"
#include "sim/base/random.h"

namespace earshot {

EpisodeEntry::EpisodeEntry(const BatchSetup& setup, const BatchRows& rows)
    : setup_(&setup),
      keeps_path_(rows.of(SensorKind::topdown_map) != nullptr),
      looks_(std::ranges::any_of(
          rows.table(), [](const SensorSpec& sensor) { return sensor.kind == SensorKind::rgb || sensor.kind == SensorKind::semantic; })),
      oracle_(setup.set->episodes.size() * setup.per_env) {}

std::optional<std::uint64_t> EpisodeEntry::choose(const Agent& agent, int count, std::uint32_t attempt) const {
  const std::uint64_t num_episodes = setup_->set->episodes.size();
  const auto number = static_cast<std::uint32_t>(count);
  if (setup_->config.order == EpisodeOrder::random)
    return RandomStream(agent.seed, Purpose::episode_order, agent.stream, number, attempt)
        .below(static_cast<std::uint32_t>(num_episodes), 0);
  const std::uint64_t index =
      static_cast<std::uint32_t>(agent.env_id) + std::uint64_t{number} * static_cast<std::uint64_t>(setup_->total_envs);
  return index < num_episodes ? std::optional(index) : std::nullopt;
}

void EpisodeEntry::prefetch(std::uint64_t episode_index) const {
  if (!setup_->config.prefetch) return;
  const Episode& episode = setup_->set->episodes[episode_index];
  const float height_m = setup_->config.task.source_height_m;
  setup_->scenes->prefetch(episode.scene_id, episode.goal_position, height_m);
  for (const EpisodeSource& source : episode.sources)
    if (source.path.empty() && source.position != episode.goal_position)
      setup_->scenes->prefetch(episode.scene_id, source.position, height_m);
}

void EpisodeEntry::prepare(EnvRun& run, std::uint64_t episode_index, int episode_count) const {
  const std::size_t max_steps = size_of(setup_->config.task.max_steps);
  run.phase = EpisodePhase::running;
  run.steps = 0;
  run.was_placed = false;
  for (Agent& agent : run.agents) {
    agent.fault.reset();
    agent.episode_index = episode_index;
    agent.episode_count = episode_count;
    agent.state = {};
    agent.waits = false;
    agent.actions.clear();
    agent.actions.reserve(max_steps);
    agent.pictures_are_current = false;
    agent.pictures_now = {};
    agent.path.clear();
    if (keeps_path_) agent.path.reserve(max_steps + 1);
  }
}

void EpisodeEntry::leave(EnvRun& run) {
  run.sounds.clear();
  run.other_goals.clear();
  for (Agent& agent : run.agents) {
    agent.source.reset();
    agent.appearance.reset();
  }
}

void EpisodeEntry::enter(EnvRun& run) {
  const Episode& episode = setup_->set->episodes[run.agents.front().episode_index];
  leave(run);  // first, so that the cache may drop the last episode's scene for this one's
  const auto source = setup_->scenes->source(episode.scene_id, episode.goal_position, setup_->config.task.source_height_m);
  const EnvScene& scene = *source->scene;
  const auto appearance = looks_ ? scene.looks->of(*scene.scene) : nullptr;
  for (const glm::dvec3 other : episode.other_goals) run.other_goals.emplace_back(scene.navmesh, scene.scene->to_local(other));
  const bool hears = setup_->config.observation.hears();
  std::function<double(const std::string&)> clip_length_s;
  if (hears)
    clip_length_s = [this](const std::string& name) {
      const SoundClip& clip = setup_->sounds.sound(name).clip;
      return static_cast<double>(clip.samples.size()) / static_cast<double>(clip.sample_rate_hz);
    };
  const double silent_from_s = goal_silent_from_s(episode, clip_length_s);
  for (Agent& agent : run.agents) {
    agent.source = source;
    agent.appearance = appearance;
  }
  for (Agent& agent : run.agents) {
    if (run.fault()) return;
    enter_agent(run, agent, silent_from_s);
  }
  if (!run.fault() && hears) run.sounds.begin(*setup_, run.agents);
}

/// Puts an agent where it starts.
void EpisodeEntry::enter_agent(const EnvRun& run, Agent& agent, double silent_from_s) {
  const TaskConfig& task = setup_->config.task;
  const Episode& episode = setup_->set->episodes[agent.episode_index];
  const EnvScene& scene = *agent.source->scene;
  const NearestGoal goal = run.goal_of(agent);
  const EpisodeAgent* further = agent.number > 0 ? &episode.other_agents[size_of(agent.number - 1)] : nullptr;
  const auto start = scene.navmesh.snap(scene.scene->to_local(further ? further->start_position : episode.start_position));
  const auto distance_m = start ? goal.distance_m(*start) : std::nullopt;
  if (!distance_m || !std::isfinite(*distance_m)) {
    std::string detail = start ? "no walkable path leads from its start to its goal" : "its start is off the walkable surface";
    if (further) detail += fmt::format(" (agent {})", agent.number);
    return FaultDesk::report(agent, Fault::path, std::move(detail));
  }
  const double heading_rad = heading_of(further ? further->start_rotation : episode.start_rotation);
  // Counted here and not read from the file: published sets count 1 m steps and 90 degree turns (docs/reference/conventions.md, section 7).
  const int known = further ? task.max_steps : episode.num_action;
  const int oracle_actions = oracle_.of(agent.episode_index * setup_->per_env + size_of(agent.number), [&] {
    return std::max(1, count_oracle_actions(task, scene.navmesh, goal, *start, heading_rad).value_or(known));
  });
  agent.state.begin(task, goal, *start, heading_rad, oracle_actions, silent_from_s);
  agent.start_pose = agent.state.pose(task);
  if (!keeps_path_) return;
  agent.path.push_back(*start);
  agent.goals.assign(1, scene.scene->to_local(episode.goal_position));
  for (const glm::dvec3 other : episode.other_goals) agent.goals.push_back(scene.scene->to_local(other));
}

}  // namespace earshot
