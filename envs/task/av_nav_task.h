// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "envs/task/action.h"
#include "envs/task/nearest_goal.h"
#include "sim/base/random.h"
#include "sim/base/text/config_reader.h"
#include "sim/nav/motion.h"
#include "sim/vision/camera.h"

namespace earshot {

/// How an agent goes forward.
enum class Motion {
  continuous,  ///< slides along what is in its way
  grid,        ///< the whole step or none: with forward_m 1 and turn_deg 90 the grid of the original task
};

/// Actuation noise of a step: independent Gaussian errors of every step, as in PyRobot's model of the LoCoBot (Murali et
/// al. 2019), whose errors of the distance, of a turn and of the heading while driving straight are kept, without its means and its drift
/// to the side.  Standard deviations; all zero: none.
struct ActuationNoise {
  float forward_m = 0;  ///< of the distance that `forward` goes, [0, a third of task.forward_m]
  float turn_deg = 0;   ///< of the angle that `left` and `right` turn by, [0, 45]
  float veer_deg = 0;   ///< of the angle by which `forward` changes the heading, [0, 45]
  [[nodiscard]] bool any() const { return forward_m > 0 || turn_deg > 0 || veer_deg > 0; }
};

/// Noise that a step adds to its action: metres along the heading, and radians to the left.
struct ActuationError {
  float forward_m = 0;
  double turn_rad = 0;
};
/// The error of a step that takes this action, from the numbers of `random`.
ActuationError draw_actuation_error(const ActuationNoise& noise, Action action, const RandomStream& random);

/// Continuous AV-Nav (docs/reference/conventions.md, section 6).
struct TaskConfig {
  Motion motion = Motion::continuous;
  float step_time_s = 0.15f;
  float forward_m = 0.15f;
  float turn_deg = 10.f;          ///< divides 360
  float success_radius_m = 1.0f;  ///< geodesic
  int max_steps = 500;
  float step_reward = -0.01f, distance_reward = 1.0f, success_reward = 10.0f;
  float ear_height_m = 1.5f, source_height_m = 1.5f;
  ActuationNoise actuation_noise = {};
};
void read(ConfigReader& reader, TaskConfig& config);
/// Throws InputError "key = value: rule".
void validate(const TaskConfig& config);

/// Metrics of a finished episode (docs/reference/conventions.md, section 7; SNA with an oracle of the same actions).
struct EpisodeMetrics {
  double success = 0, spl = 0, soft_spl = 0, sna = 0, dtg_m = 0, reward = 0;
  double success_when_silent = 0;  ///< success, and the sound of the goal had ended by then (SWS of Chen, Al-Halah and Grauman 2021)
  int steps = 0, collisions = 0;
  bool stopped = false;  ///< ended by `stop`, in success or not; else out of steps
};

/// Whole turns in a circle: 36 for turns of 10 degrees.
int turns_per_circle(const TaskConfig& config);

/// Other agents, which block a walk: upright cylinders.
struct BodiesAround {
  std::vector<glm::vec3> places = {};  ///< foot points
  float apart_m = 0;                   ///< least distance of the axes: twice the radius
  float height_m = 0;                  ///< places further above or below than this are on another floor
};
/// The fraction in [0, 1] of the straight way from `from` to `to` (horizontal; on one floor) after which the first body is met.  1: none
/// is. A body that overlaps the start does not block movement away from it.
double free_fraction(const BodiesAround& around, glm::vec3 from, glm::vec3 to);

/// State of one agent in one episode: motion, reward and end.  A plain value; no rendering.
class AvNavState {
 public:
  /// start_heading_rad plus turns * turn_deg is the heading: integer turns, so 36 turns of 10 degrees are no turn (H-54, H-58).  Errors of
  /// actuation are summed beside them.
  /// silent_from_s: when the sound of the goal ends, from the start of the episode.  Throws InputError if no path leads from `start` to the
  /// goal.
  void begin(const TaskConfig& config, const NearestGoal& goal, glm::vec3 start, double start_heading_rad, int oracle_actions,
             double silent_from_s = std::numeric_limits<double>::infinity());
  /// Puts the agent elsewhere, as it is after `steps` steps: by no action, so that nothing of it counts for a metric but the distance to
  /// the goal.  Throws InputError if no path leads from `position` to the goal.
  void place(const NearestGoal& goal, glm::vec3 position, double heading_rad, int steps);
  /// Applies one action; returns the reward.  A forward step never goes back, whatever its error.  Afterwards terminated() (stop called),
  /// truncated() (out of steps) and collided() are current. around: a step forward ends where the first of them is met, and on the grid
  /// does not begin; that is a collision.
  float step(const TaskConfig& config, const Navmesh& navmesh, const NearestGoal& goal, Action action, ActuationError error = {},
             const BodiesAround& around = {});

  [[nodiscard]] Pose pose(const TaskConfig& config) const;
  [[nodiscard]] bool terminated() const { return terminated_; }
  [[nodiscard]] bool truncated() const { return truncated_; }
  [[nodiscard]] bool collided() const { return collided_; }
  [[nodiscard]] int steps() const { return steps_; }
  [[nodiscard]] float distance_to_goal_m() const { return distance_m_; }
  /// Steps at which the distance was not available (the last known one is used, so rewards stay finite).
  [[nodiscard]] int lost_distances() const { return lost_distances_; }
  [[nodiscard]] EpisodeMetrics metrics(const TaskConfig& config) const;

 private:
  glm::vec3 position_{0};
  double start_heading_rad_ = 0, heading_error_rad_ = 0, path_m_ = 0, reward_ = 0, silent_from_s_ = std::numeric_limits<double>::infinity();
  int turns_ = 0, steps_ = 0, collisions_ = 0, oracle_actions_ = 1, lost_distances_ = 0;
  float start_distance_m_ = 0, distance_m_ = 0;
  bool terminated_ = false, truncated_ = false, collided_ = false;
};

/// The oracle: next action along the geodesic with this task's step sizes.  `stop` once within half of the success radius.
Action oracle_action(const TaskConfig& config, const NearestGoal& goal, const Pose& pose);
/// Number of actions of the oracle from a start, stop included; nullopt if it does not succeed within 4 * max_steps.
std::optional<int> count_oracle_actions(const TaskConfig& config, const Navmesh& navmesh, const NearestGoal& goal, glm::vec3 start,
                                        double heading_rad);

}  // namespace earshot
