// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "envs/episodes/episode_set.h"
#include "envs/task/av_nav_task.h"
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

/// Whether there is free air from knee height to `top_m` above a foot point.
bool stands_free(const Scene& scene, glm::vec3 foot, float top_m);

/// The episodes to generate in one scene.
struct EpisodeRequest {
  TaskConfig task = {};
  EpisodeFilter filter = {};
  std::vector<std::string> sounds = {};  ///< each episode draws one
  int count = 0;                         ///< episodes
  std::uint64_t seed = 0;
  int num_goals = 0;  ///< that the episodes share; 0: every episode has a goal of its own
};

/// request.count episodes in one scene: start and goal uniform on the largest island, with free air from knee to ear or source (the navmesh
/// resolves walls to a cell only, and a source inside a shelf would be inaudible), sound drawn from request.sounds, heading uniform over
/// multiples of the turn.  A function of (scene_id, scene, request), independent of other calls.  Throws InputError if the filter finds
/// none in max_tries. num_goals > 0: the episodes share the goals of spread_goals, each taking one at random among those that the filter
/// lets it have, so that what is made once per source (source fields, distances) serves many episodes.
std::vector<Episode> generate_episodes(const std::string& scene_id, const Scene& scene, const Navmesh& navmesh,
                                       const EpisodeRequest& request);

/// request.num_goals foot points on the largest island with free air up to the source, far from each other: each is the farthest from those
/// before it among 20 random places (best-candidate sampling: Mitchell 1991, "Spectrally optimal sampling for distribution ray tracing").
/// In the coordinates of the engine.  A function of (scene_id, request.seed), the first n whatever their number.  Sounds and count of the
/// request are not used.  Throws InputError if max_tries places in a row are not free.
std::vector<glm::vec3> spread_goals(const std::string& scene_id, const Scene& scene, const Navmesh& navmesh, const EpisodeRequest& request);

}  // namespace earshot
