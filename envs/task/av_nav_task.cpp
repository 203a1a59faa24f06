// SPDX-License-Identifier: Apache-2.0
#include "envs/task/av_nav_task.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/errors.h"
#include "sim/base/text/config_reader.h"

namespace earshot {
namespace {

/// Steps on a grid end on its nodes, up to what a slide along the navmesh rounds.
constexpr float kGridToleranceM = 0.02f;

}  // namespace

void read(ConfigReader& reader, TaskConfig& config) {
  reader.read_choice<Motion>("motion", config.motion, {{"continuous", Motion::continuous}, {"grid", Motion::grid}},
                             "Motion of the agent. continuous: it slides along obstacles. grid: it makes the whole step or none.");
  reader.read("step_time_s", config.step_time_s, Allowed::between(0.001, 10),
              "Duration of a step, of every action; a whole number of samples of sound.");
  reader.read("forward_m", config.forward_m, Allowed::between(0.01, 10), "Distance of the action forward.");
  reader.read("turn_deg", config.turn_deg, Allowed::between(0.1, 180), "Angle of the actions left and right; it divides 360.");
  reader.read("success_radius_m", config.success_radius_m, Allowed::between(0.01, 100),
              "Geodesic distance to the goal within which a stop is a success.");
  reader.read("max_steps", config.max_steps, Allowed::between(1, 1'000'000), "Steps after which an episode is truncated.");
  reader.read("step_reward", config.step_reward, "Reward of every step.");
  reader.read("distance_reward", config.distance_reward, "Reward per metre by which a step shortens the geodesic distance to the goal.");
  reader.read("success_reward", config.success_reward, "Reward of a stop within success_radius_m of the goal.");
  reader.read("ear_height_m", config.ear_height_m, Allowed::between(0.05, 10), "Height of the ears above the floor.");
  reader.read("source_height_m", config.source_height_m, Allowed::between(0.05, 10), "Height of sources above the floor.");
  ConfigReader noise = reader.child("actuation_noise", "Gaussian errors of every step, as standard deviations; 0: none.");
  noise.read("forward_m", config.actuation_noise.forward_m, Allowed::at_least(0),
             "Error of the distance of forward; at most a third of it.");
  noise.read("turn_deg", config.actuation_noise.turn_deg, Allowed::between(0, 45), "Error of the angle of left and right.");
  noise.read("veer_deg", config.actuation_noise.veer_deg, Allowed::between(0, 45), "Angle by which forward changes the heading.");
  noise.finish();
}

void validate(const TaskConfig& config) {
  check_values(config, "task");
  require(std::abs(360.f / config.turn_deg - std::round(360.f / config.turn_deg)) < 1e-3f, "task.turn_deg", config.turn_deg,
          "must divide 360, so that a full circle of turns leads back to the same heading");
  const ActuationNoise& noise = config.actuation_noise;
  require(noise.forward_m <= config.forward_m / 3, "task.actuation_noise.forward_m", noise.forward_m,
          "must be in [0, forward_m / 3], so that a forward step never moves backwards");
  require(config.motion == Motion::continuous || !noise.any(), "task.actuation_noise", "on",
          "has no effect with task.motion: grid, whose steps are exact");
}

ActuationError draw_actuation_error(const ActuationNoise& noise, Action action, const RandomStream& random) {
  if (!noise.any() || action == Action::stop) return {};
  const auto [along, around] = random.normal2(0);
  constexpr double radians = std::numbers::pi / 180.0;
  if (action == Action::forward) return {.forward_m = noise.forward_m * along, .turn_rad = radians * noise.veer_deg * around};
  return {.turn_rad = radians * noise.turn_deg * around};
}

int turns_per_circle(const TaskConfig& config) { return static_cast<int>(std::lround(360.f / config.turn_deg)); }

void AvNavState::begin(const TaskConfig&, const NearestGoal& goal, glm::vec3 start, double start_heading_rad, int oracle_actions,
                       double silent_from_s) {
  const std::optional<float> distance_m = goal.distance_m(start);
  if (!distance_m || !std::isfinite(*distance_m))
    throw InputError("episode", "no walkable path leads from its start to its goal",
                     "remove it from the set, or write the set again for this scene and agent size");
  *this = AvNavState{};
  position_ = start;
  start_heading_rad_ = start_heading_rad;
  oracle_actions_ = std::max(1, oracle_actions);
  start_distance_m_ = distance_m_ = *distance_m;
  silent_from_s_ = silent_from_s;
}

void AvNavState::place(const NearestGoal& goal, glm::vec3 position, double heading_rad, int steps) {
  const std::optional<float> distance_m = goal.distance_m(position);
  if (!distance_m || !std::isfinite(*distance_m))
    throw InputError("place", "no walkable path leads from there to the goal", "choose a place on the floor that the goal is on");
  position_ = position;
  start_heading_rad_ = heading_rad;
  heading_error_rad_ = 0;
  turns_ = 0;
  steps_ = steps;
  distance_m_ = *distance_m;
  collided_ = false;
}

double free_fraction(const BodiesAround& around, glm::vec3 from, glm::vec3 to) {
  constexpr double kClearanceM = 1e-4;  // stops this far before contact: far above the rounding of float positions
  const glm::dvec3 way(to - from);
  const double length_m = std::hypot(way.x, way.z);
  double free = 1;
  if (!(length_m > 0)) return free;
  for (const glm::vec3 place : around.places) {
    if (std::abs(place.y - from.y) > around.height_m) continue;
    const glm::dvec3 apart = glm::dvec3(from) - glm::dvec3(place);
    const double approach = (apart.x * way.x + apart.z * way.z) / length_m;  // metres per metre, times the distance
    if (!(approach < 0)) continue;
    const double gap = apart.x * apart.x + apart.z * apart.z - double{around.apart_m} * double{around.apart_m};
    if (gap <= 0) return 0;
    const double discriminant = approach * approach - gap;
    if (!(discriminant > 0)) continue;
    const double contact_m = -approach - std::sqrt(discriminant);
    if (contact_m < length_m) free = std::min(free, std::max(0.0, (contact_m - kClearanceM) / length_m));
  }
  return free;
}

float AvNavState::step(const TaskConfig& config, const Navmesh& navmesh, const NearestGoal& goal, Action action, ActuationError error,
                       const BodiesAround& around) {
  EARSHOT_EXPECT(!terminated_ && !truncated_);
  ++steps_;
  collided_ = false;
  const float before_m = distance_m_;
  switch (action) {
    case Action::stop:
      terminated_ = true;
      break;
    case Action::forward: {
      const glm::vec3 wanted = std::max(0.f, config.forward_m + error.forward_m) * forward_of(pose(config).heading_rad);
      MoveResult moved = slide(navmesh, position_, wanted);
      if (const double free = free_fraction(around, position_, moved.position); free < 1) {
        moved = slide(navmesh, position_, static_cast<float>(free) * (moved.position - position_));
        // Walls may turn the shorter move aside, into another body.
        if (free_fraction(around, position_, moved.position) < 1) moved.position = position_;
        moved.collided = true;
      }
      const glm::vec3 missing = position_ + wanted - moved.position;
      if (config.motion == Motion::grid && std::hypot(missing.x, missing.z) > kGridToleranceM)
        moved = {.position = position_, .collided = true};
      path_m_ += glm::length(glm::dvec3(moved.position) - glm::dvec3(position_));
      position_ = moved.position;
      collided_ = moved.collided;
      collisions_ += moved.collided ? 1 : 0;
      const std::optional<float> distance_m = goal.distance_m(position_);
      if (distance_m && std::isfinite(*distance_m))
        distance_m_ = *distance_m;
      else
        ++lost_distances_;
      break;
    }
    case Action::left:
    case Action::right: {
      const int circle = turns_per_circle(config);
      turns_ = (turns_ + (action == Action::left ? 1 : circle - 1)) % circle;
      break;
    }
  }
  if (error.turn_rad != 0) heading_error_rad_ = std::remainder(heading_error_rad_ + error.turn_rad, 2.0 * std::numbers::pi);
  // Stopping on the last step is still the agent's own end: no bootstrap (docs/explanation/ppo.md, section 1.1).
  truncated_ = !terminated_ && steps_ >= config.max_steps;
  float reward = config.step_reward + config.distance_reward * (before_m - distance_m_);
  if (terminated_ && distance_m_ < config.success_radius_m) reward += config.success_reward;
  reward_ += reward;
  return reward;
}

Pose AvNavState::pose(const TaskConfig& config) const {
  return {position_, start_heading_rad_ + turns_ * (2.0 * std::numbers::pi / turns_per_circle(config)) + heading_error_rad_};
}

EpisodeMetrics AvNavState::metrics(const TaskConfig& config) const {
  EpisodeMetrics m;
  const double start_m = start_distance_m_, end_m = distance_m_;
  m.success = terminated_ && distance_m_ < config.success_radius_m ? 1 : 0;
  // Anderson et al. 2018, "On evaluation of embodied navigation agents": S l / max(p, l).  A start on the goal needs no path: ratio 1.
  const double longest_m = std::max(path_m_, start_m);
  const double efficiency = longest_m > 0 ? start_m / longest_m : 1.0;
  const double progress = start_m > 0 ? std::max(0.0, 1.0 - end_m / start_m) : (end_m > 0 ? 0.0 : 1.0);
  m.spl = m.success * efficiency;
  m.soft_spl = progress * efficiency;
  m.sna = m.success * oracle_actions_ / std::max(oracle_actions_, steps_);
  m.success_when_silent = static_cast<double>(steps_) * static_cast<double>(config.step_time_s) >= silent_from_s_ ? m.success : 0;
  m.dtg_m = end_m;
  m.reward = reward_;
  m.steps = steps_;
  m.collisions = collisions_;
  m.stopped = terminated_;
  return m;
}

}  // namespace earshot
