// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

namespace earshot {

/// A place that a moving source passes.
struct Waypoint {
  double t_s = 0;          ///< after the start of the episode
  glm::dvec3 position{0};  ///< foot point, as Episode::start_position
  friend bool operator==(const Waypoint&, const Waypoint&) = default;
};

/// A sound of an episode that has more than the one at its goal.
struct EpisodeSource {
  glm::dvec3 position{0};  ///< foot point under it, as Episode::start_position
  std::string sound = {};  ///< as Episode::sound
  double onset_s = 0;      ///< after the start of the episode, >= 0
  double duration_s = -1;  ///< < 0: to the end of the episode
  bool loop = true;        ///< false: the clip is played once, from its beginning
  bool goal = false;       ///< the sound of the goal; the others distract
  float level_db = 0;      ///< over the clip's own level, in [-120, 60]
  /// Of a source that moves: straight from one to the next, at rest before the first and after the last.  Rising times; empty: it stays at
  /// `position`.  The goal itself, which distances and success are about, does not move.
  std::vector<Waypoint> path = {};
  friend bool operator==(const EpisodeSource&, const EpisodeSource&) = default;
};

/// An agent of an episode beside its first.
struct EpisodeAgent {
  glm::dvec3 start_position{0};                     ///< as Episode::start_position
  std::array<float, 4> start_rotation{0, 0, 0, 1};  ///< as Episode::start_rotation
  std::string sound = {};                           ///< that it makes wherever it goes, as Episode::sound; empty: none
  float level_db = 0;                               ///< of it, over the clip's own level, in [-120, 60]
  friend bool operator==(const EpisodeAgent&, const EpisodeAgent&) = default;
};

/// One continuous AV-Nav episode, the AudioNav JSON fields of docs/reference/formats.md, section 1.
struct Episode {
  std::string episode_id;
  std::string scene_id;                             ///< a SCENE of the command line, or a path under the scene root
  glm::dvec3 start_position{0};                     ///< foot point, in the coordinates of the scene's file
  std::array<float, 4> start_rotation{0, 0, 0, 1};  ///< quaternion x, y, z, w; only its heading is used
  glm::dvec3 goal_position{0};                      ///< foot point under the source, as start_position
  float goal_radius_m = 1e-5f;
  float geodesic_distance_m = 0;  ///< start to goal; finite and positive
  int num_action = 0;             ///< actions of the oracle with this task's step sizes, stop included
  std::string sound;              ///< `synth:...` or a file, see open_sound
  /// All sounds of the episode.  Empty: the one at the goal, which has been playing before the episode begins and does not end.
  std::vector<EpisodeSource> sources = {};
  /// Further places that are as good as goal_position: foot points, at most kMaxGoals - 1.
  std::vector<glm::dvec3> other_goals = {};
  /// Noise at the ears, so many dB below the sound of the goal at 1 m in the open; none without a number.
  std::optional<float> noise_snr_db = std::nullopt;
  /// Agents that look for the same goals in the same scene, beside the one at start_position; at most kMaxAgents - 1.
  std::vector<EpisodeAgent> other_agents = {};
  /// Of the first agent, as EpisodeAgent::sound and EpisodeAgent::level_db.
  std::string agent_sound = {};
  float agent_level_db = 0;
};
inline constexpr std::size_t kMaxAgents = 16;
inline constexpr std::size_t kMaxGoals = 16;
inline constexpr std::size_t kMaxSources = 64;
inline constexpr std::size_t kMaxWaypoints = 10000;

/// Heading (counter-clockwise from -z, radians) of a quaternion x, y, z, w; the quaternion is normalised first.  Throws InputError for zero
/// or NaN.
double heading_of(const std::array<float, 4>& rotation);
std::array<float, 4> rotation_of(double heading_rad);

}  // namespace earshot
