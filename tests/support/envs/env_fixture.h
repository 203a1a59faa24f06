// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "envs/batch/batched_env.h"
#include "envs/episodes/episode_generator.h"

namespace earshot {

/// Small and quick, and yet every stage has work: few rays, a short response, a tiny picture.
inline EnvConfig quick_env_config() {
  EnvConfig config;
  config.acoustics.rays = 8;
  config.acoustics.early_candidate_rays = 100;
  config.acoustics.rir_length_s = 0.1f;
  config.acoustics.late_decode_s = 0.02f;
  config.observation.camera.width_px = config.observation.camera.height_px = 16;
  config.observation.pointgoal = true;
  config.task.max_steps = 15;
  config.seed = 42;
  config.prefetch = false;
  return config;
}

inline std::shared_ptr<const EpisodeSet> make_set(std::vector<Episode> episodes) {
  EpisodeSet set;
  set.episodes = std::move(episodes);
  set.hash = episode_set_hash(set.episodes);
  return std::make_shared<const EpisodeSet>(std::move(set));
}

/// Episodes in two rooms and one house, so that envs of a batch stand in different scenes.
inline std::shared_ptr<const EpisodeSet> quick_set(int per_scene) {
  static const std::vector<std::string> scenes = {"house:2,rooms=2,area_m2=30", "shoebox:6x3x5@0.3", "shoebox:7x2.8x4@0.5"};
  EpisodeFilter filter;
  filter.min_geodesic_m = 2;
  filter.min_ratio = 0;
  std::vector<Episode> all;
  for (const std::string& id : scenes) {
    const Scene scene = load_scene(id);
    const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
    for (Episode& episode : generate_episodes(
             id, scene, navmesh,
             {.filter = filter, .sounds = {"synth:telephone", "synth:noise", "synth:speech:3"}, .count = per_scene, .seed = 7})) {
      episode.episode_id = std::to_string(all.size());
      all.push_back(std::move(episode));
    }
  }
  return make_set(std::move(all));
}

/// One episode in an empty room.
inline Episode room_episode(const std::string& room, glm::vec3 start, double heading_rad, glm::vec3 goal, const std::string& sound) {
  Episode episode;
  episode.episode_id = "0";
  episode.scene_id = room;
  episode.start_position = start;
  episode.start_rotation = rotation_of(heading_rad);
  episode.goal_position = goal;
  episode.geodesic_distance_m = 1;
  episode.num_action = 1;
  episode.sound = sound;
  return episode;
}

}  // namespace earshot
