#pragma once

#include <string>
#include <vector>

#include "envs/av_nav_task.h"
#include "envs/episode_set.h"
#include "sim/scene/scene.h"

namespace earshot {

/// Which episodes of a scene are kept.
struct EpisodeFilter {
  float min_geodesic_m = 4.f, max_geodesic_m = 100.f;  ///< start to goal
  float min_ratio = 1.1f;                              ///< geodesic over straight distance
  int max_tries = 1000;                                ///< per episode
};
void read(ConfigReader& reader, EpisodeFilter& filter);
/// Throws InputError "key = value: rule".
void validate(const EpisodeFilter& filter);

/// `count` episodes in one scene: start and goal uniform on the largest island, sound drawn from `sounds`, heading uniform over multiples
/// of the turn. A function of (scene_id, seed) and the arguments, independent of other calls.  Throws InputError if the filter finds none
/// in max_tries.
std::vector<Episode> generate_episodes(const std::string& scene_id, const Navmesh& navmesh, const TaskConfig& task,
                                       const EpisodeFilter& filter, const std::vector<std::string>& sounds, int count, std::uint64_t seed);
/// The same, and start and goal have free air from knee to ear or source: the navmesh resolves walls to a cell only, and a source inside
/// a shelf would be inaudible.
std::vector<Episode> generate_episodes(const std::string& scene_id, const Scene& scene, const Navmesh& navmesh, const TaskConfig& task,
                                       const EpisodeFilter& filter, const std::vector<std::string>& sounds, int count, std::uint64_t seed);

}  // namespace earshot
