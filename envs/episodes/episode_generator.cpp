// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/episode_generator.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// Draw numbers of one try, fixed so that a new consumer does not shift the others.
struct EpisodeDraw {
  enum : std::uint32_t { start = 0, goal = 2, heading = 4, sound = 5 };
};

/// Below this height the navmesh's floor may lie inside the real one by a cell or a step.
constexpr float kKneeHeight_m = 0.3f;

bool passes(const EpisodeFilter& filter, float geodesic_m, float straight_m) {
  return geodesic_m >= filter.min_geodesic_m && geodesic_m <= filter.max_geodesic_m && geodesic_m >= filter.min_ratio * straight_m;
}

/// In the place of an episode's index, which is an int: the stream of the goals.
constexpr std::uint32_t kGoalsOfTheScene = 0xFFFFFFFFu;
constexpr int kPlacesPerGoal = 20;

/// Goals that episodes share, with their distances, which are built when the first path to them is measured.
struct SharedGoals {
  std::vector<glm::vec3> places;
  std::vector<std::optional<GeodesicField>> fields;
  const GeodesicField& field_of(const Navmesh& navmesh, std::size_t index) {
    if (!fields[index]) fields[index].emplace(navmesh, places[index]);
    return *fields[index];
  }
};

std::optional<Episode> draw_episode(const RandomStream& random, const Scene& scene, const Navmesh& navmesh, const EpisodeRequest& request,
                                    SharedGoals& shared) {
  const TaskConfig& task = request.task;
  const EpisodeFilter& filter = request.filter;
  const std::size_t which = shared.places.empty() ? 0 : random.below(static_cast<std::uint32_t>(shared.places.size()), EpisodeDraw::goal);
  const glm::vec3 start = navmesh.random_point(random, EpisodeDraw::start),
                  goal = shared.places.empty() ? navmesh.random_point(random, EpisodeDraw::goal) : shared.places[which];
  const float straight_m = glm::length(goal - start);
  if (!(straight_m > 0) || straight_m > filter.max_geodesic_m) return std::nullopt;
  // The plain path query refuses most draws before a distance field is built for the goal.
  const auto path_m = navmesh.path_length_m(start, goal);
  if (!path_m || !passes(filter, *path_m, straight_m)) return std::nullopt;
  if (!(stands_free(scene, start, task.ear_height_m) && stands_free(scene, goal, task.source_height_m))) return std::nullopt;

  std::optional<GeodesicField> masked_field;
  if (shared.places.empty()) masked_field.emplace(navmesh, goal);
  const GeodesicField& field = masked_field ? *masked_field : shared.field_of(navmesh, which);
  const auto geodesic_m = field.distance_m(start);
  if (!geodesic_m || !std::isfinite(*geodesic_m) || !passes(filter, *geodesic_m, straight_m)) return std::nullopt;
  const auto turns = static_cast<double>(random.below(static_cast<std::uint32_t>(turns_per_circle(task)), EpisodeDraw::heading));
  Episode episode;
  episode.start_rotation = rotation_of(turns * 2.0 * std::numbers::pi / turns_per_circle(task));
  // Counted from the heading that a reader of the file gets.
  const auto actions = count_oracle_actions(task, navmesh, field, start, heading_of(episode.start_rotation));
  if (!actions || *actions > task.max_steps) return std::nullopt;
  episode.start_position = scene.to_world(start);
  episode.goal_position = scene.to_world(goal);
  episode.geodesic_distance_m = *geodesic_m;
  episode.num_action = *actions;
  return episode;
}

}  // namespace

bool stands_free(const Scene& scene, glm::vec3 foot, float top_m) {
  return top_m <= kKneeHeight_m || !scene.rays().occluded(foot + glm::vec3(0, kKneeHeight_m, 0), foot + glm::vec3(0, top_m, 0));
}

void read(ConfigReader& reader, EpisodeFilter& filter) {
  reader.read("min_geodesic_m", filter.min_geodesic_m, Allowed::above(0), "Shortest geodesic distance from start to goal.");
  reader.read("max_geodesic_m", filter.max_geodesic_m, Allowed::above(0), "Longest geodesic distance; at least min_geodesic_m.");
  reader.read("min_ratio", filter.min_ratio, Allowed::between(0, 100), "Least ratio of the geodesic to the straight distance.");
  reader.read("max_tries", filter.max_tries, Allowed::at_least(1), "Attempts per episode before the filter counts as too strict.");
}

void validate(const EpisodeFilter& filter) {
  check_values(filter, "filter");
  require(filter.max_geodesic_m >= filter.min_geodesic_m, "max_geodesic_m", filter.max_geodesic_m,
          "must be finite and at least min_geodesic_m");
}

std::vector<Episode> generate_episodes(const std::string& scene_id, const Scene& scene, const Navmesh& navmesh,
                                       const EpisodeRequest& request) {
  const EpisodeFilter& filter = request.filter;
  const std::vector<std::string>& sounds = request.sounds;
  validate(request.task);
  validate(filter);
  require(request.count >= 0, "count", request.count, "must not be negative");
  if (sounds.empty()) throw InputError(scene_id, "the list of sounds is empty", "give at least one sound, for example synth:telephone");
  SharedGoals shared{.places = spread_goals(scene_id, scene, navmesh, request), .fields = {}};
  shared.fields.resize(shared.places.size());
  const auto scene_word = static_cast<std::uint32_t>(hash64(scene_id));
  std::vector<Episode> episodes;
  episodes.reserve(static_cast<std::size_t>(request.count));
  for (int index = 0; index < request.count; ++index) {
    std::optional<Episode> episode;
    for (int attempt = 0; attempt < filter.max_tries && !episode; ++attempt) {
      const RandomStream random(request.seed, Purpose::episode, scene_word, static_cast<std::uint32_t>(index),
                                static_cast<std::uint32_t>(attempt));
      episode = draw_episode(random, scene, navmesh, request, shared);
      if (episode) episode->sound = sounds[random.below(static_cast<std::uint32_t>(sounds.size()), EpisodeDraw::sound)];
    }
    if (!episode)
      throw InputError(scene_id,
                       fmt::format("found no episode with a path of {} to {} m and at least {} times the straight distance after {} tries",
                                   filter.min_geodesic_m, filter.max_geodesic_m, filter.min_ratio, filter.max_tries),
                       "widen the filter (min_geodesic_m, min_ratio), or use a larger scene");
    episode->episode_id = std::to_string(index);
    episode->scene_id = scene_id;
    episodes.push_back(std::move(*episode));
  }
  return episodes;
}

std::vector<glm::vec3> spread_goals(const std::string& scene_id, const Scene& scene, const Navmesh& navmesh,
                                    const EpisodeRequest& request) {
  const float source_height_m = request.task.source_height_m;
  const int max_tries = request.filter.max_tries;
  validate(request.task);
  validate(request.filter);
  require(request.num_goals >= 0, "goals_per_scene", request.num_goals, "must not be negative; 0: each episode has its own goal");
  const auto scene_word = static_cast<std::uint32_t>(hash64(scene_id));
  std::vector<glm::vec3> goals;
  std::uint32_t draw = 0;
  for (int i = 0; i < request.num_goals; ++i) {
    float farthest_m = -1.f;
    glm::vec3 best{0};
    for (int found = 0, occupied = 0; found < kPlacesPerGoal && occupied < max_tries;) {
      const RandomStream random(request.seed, Purpose::episode, scene_word, kGoalsOfTheScene, draw++);
      const glm::vec3 place = navmesh.random_point(random, EpisodeDraw::goal);
      if (!stands_free(scene, place, source_height_m)) {
        ++occupied;
        continue;
      }
      ++found;
      float nearest_m = std::numeric_limits<float>::max();
      for (const glm::vec3 goal : goals) nearest_m = std::min(nearest_m, glm::length(goal - place));
      if (nearest_m > farthest_m) {
        farthest_m = nearest_m;
        best = place;
      }
    }
    if (farthest_m < 0)
      throw InputError(scene_id, fmt::format("none of {} positions has free air up to {} m", max_tries, source_height_m),
                       "lower task.source_height_m, or use another scene");
    goals.push_back(best);
  }
  return goals;
}

}  // namespace earshot
