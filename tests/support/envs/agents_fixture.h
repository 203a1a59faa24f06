// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/env_roll_out.h"

namespace earshot {

inline constexpr const char* kRoom = "shoebox:8x3x6@0.4";
inline constexpr std::int32_t kStop = 0, kForward = 1, kLeft = 2;

/// Two in an empty room, the first at (1, 4) looking along +x.
inline Episode two_in_a_room(glm::dvec3 second, const std::string& sound = "") {
  Episode episode = room_episode(kRoom, {1, 0, 4}, -0.5 * std::numbers::pi, {7, 0, 1}, "synth:noise");
  episode.other_agents = {{.start_position = second, .start_rotation = rotation_of(0.5 * std::numbers::pi), .sound = sound}};
  return episode;
}

inline EnvConfig two_agents() {
  EnvConfig config = quick_env_config();
  config.agents = 2;
  config.order = EpisodeOrder::once;
  config.task.max_steps = 60;
  config.observation.semantic = config.observation.collision = true;
  return config;
}

/// All that a policy may read of one agent.
inline std::vector<std::byte> shown_to_agent(const BatchedEnv& env, int row) {
  std::vector<std::byte> all;
  const auto count = static_cast<std::size_t>(env.num_rows());
  const auto i = static_cast<std::size_t>(row);
  for (const SensorSpec& sensor : env.sensors())
    for (const auto rows : {env.rows(sensor.name), env.final_rows(sensor.name)}) roll_outs::append_row(all, rows, i, count);
  for (const std::uint8_t flag :
       {env.terminated()[i], env.truncated()[i], env.active()[i], env.collided()[i], env.quarantined()[i], env.acted()[i]})
    all.push_back(static_cast<std::byte>(flag));
  const float reward = env.rewards()[i];
  const auto bytes = std::as_bytes(std::span(&reward, 1));
  all.insert(all.end(), bytes.begin(), bytes.end());
  return all;
}

/// Three agents, the second and the third with sounds, in two rooms and a house.
class SeveralAgents : public testing::Test {
 protected:
  static constexpr int kAgents = 3;
  static EnvConfig several_agents() {
    EnvConfig config = quick_env_config();
    config.agents = kAgents;
    config.observation.waveform = config.observation.heard = config.observation.gps_compass = config.observation.collision = true;
    config.observation.rgb = config.observation.semantic = config.observation.depth_noise = true;
    return config;
  }
  static std::shared_ptr<const EpisodeSet> with_agents(const EpisodeSet& alone) {
    std::vector<Episode> all = alone.episodes;
    for (Episode& episode : all) {
      // On the way between start and goal, which is free in these scenes.
      const glm::dvec3 way = episode.goal_position - episode.start_position;
      episode.other_agents = {{.start_position = episode.start_position + 0.3 * way, .sound = "synth:bird"},
                              {.start_position = episode.start_position + 0.6 * way,
                               .start_rotation = rotation_of(1.5),
                               .sound = "synth:alarm",
                               .level_db = -6}};
      episode.agent_sound = "synth:engine";
    }
    return make_set(std::move(all));
  }
  static std::vector<std::int32_t> actions_of(int first_env, int envs, int agents, int step) {
    std::vector<std::int32_t> actions;
    for (int env = 0; env < envs; ++env)
      for (int agent = 0; agent < agents; ++agent) actions.push_back(roll_outs::test_action(first_env + env, agents * step + agent));
    return actions;
  }
  EnvConfig config_ = several_agents();
  std::shared_ptr<const EpisodeSet> set_ = with_agents(*quick_set(2));
  std::shared_ptr<SceneCache> scenes_ = make_scene_cache(config_);
};

}  // namespace earshot
