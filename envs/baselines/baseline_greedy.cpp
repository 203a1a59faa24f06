// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/baseline_greedy.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace earshot {
namespace {

// Levels are of the louder ear per unit of EnvConfig::sound_gain.  Most synthetic sounds have an RMS near -19 dB; in four furnished houses
// they were heard at -34.6 dB (median) between 0.5 and 1 m from the goal, and at -43 dB at 3 m.
constexpr double kStopLevel_db = -34;
constexpr double kTurnDifference_db = 2;
constexpr double kSilence_db = -110;
constexpr float kNear_m = 0.35f;      ///< blocked
constexpr float kOpen_m = 0.8f;       ///< free enough to walk off in an escape
constexpr int kPatience_steps = 20;   ///< after which it must have come
constexpr double kProgress_m = 0.45;  ///< as far as this
constexpr float kExploration = 0.5f;
constexpr double kMinEscape_rad = std::numbers::pi / 4;
constexpr int kWalk_steps = 6, kLongestWalk_steps = 24;

double decibels(double power) { return 10.0 * std::log10(std::max(power, 1e-30)); }

/// Mean level at the left and the right ear over the last `count` samples.
struct EarLevels {
  double left_db, right_db;
};

EarLevels ear_levels(std::span<const float> heard, std::size_t count, double gain) {
  const std::size_t samples = heard.size() / 2;
  const auto level_db = [&](std::size_t ear) {
    double energy = 0;
    for (const float x : heard.subspan((ear + 1) * samples - count, count)) energy += static_cast<double>(x) * static_cast<double>(x);
    return decibels(energy / static_cast<double>(count) / (gain * gain));
  };
  return {level_db(0), level_db(1)};
}

}  // namespace

GreedyAgent::GreedyAgent(const EnvConfig& config)
    : task_(config.task), camera_(config.observation.camera), sound_gain_(config.sound_gain) {}

/// Nearest depth in metres in the columns between two fractions of the width, and the middle half of the rows; max_depth_m if blind.
float GreedyAgent::clearance_m(std::span<const float> depth, double from, double to) const {
  if (depth.empty()) return camera_.max_depth_m;
  const auto width = static_cast<std::size_t>(camera_.width_px), height = static_cast<std::size_t>(camera_.height_px);
  const auto first = static_cast<std::size_t>(from * static_cast<double>(width)),
             last = static_cast<std::size_t>(to * static_cast<double>(width));
  float nearest = 1.f;
  for (std::size_t y = height / 4; y < 3 * height / 4; ++y)
    for (std::size_t x = first; x < last; ++x) nearest = std::min(nearest, depth[y * width + x]);
  return nearest * camera_.max_depth_m;
}

/// By its own actions; a step that collided counts for nothing.
void GreedyAgent::note_progress(bool collided) {
  Memory& m = memory_;
  const double turn_rad = task_.turn_deg * std::numbers::pi / 180.0;
  if (m.last == Action::left) m.heading_rad += turn_rad;
  if (m.last == Action::right) m.heading_rad -= turn_rad;
  if (m.last == Action::forward && !collided) {
    m.x_m -= task_.forward_m * std::sin(m.heading_rad);
    m.z_m -= task_.forward_m * std::cos(m.heading_rad);
  }
  ++m.steps;
}

/// Begins an escape or, within one, makes it larger.
void GreedyAgent::escape(const BaselineObservation& observation, const RandomStream& random) {
  Memory& m = memory_;
  if (m.side == 0) {
    const float left_m = clearance_m(observation.depth, 0, 0.4), right_m = clearance_m(observation.depth, 0.6, 1);
    m.side = left_m > right_m || (left_m == right_m && random.uniform(0) < 0.5f) ? 1 : -1;
  }
  const double least_rad = std::min(std::numbers::pi, kMinEscape_rad * (1 + m.escapes));
  m.turns = std::max(1, static_cast<int>(std::lround(least_rad / (task_.turn_deg * std::numbers::pi / 180.0))));
  m.turned = 0;
  m.walk = std::min(kLongestWalk_steps, kWalk_steps * (1 + m.escapes));
  ++m.escapes;
}

Action GreedyAgent::act(const BaselineObservation& observation, const RandomStream& random) {
  Memory& m = memory_;
  note_progress(observation.collided);
  EarLevels now{kSilence_db, kSilence_db};
  if (!observation.heard.empty()) {
    const double gain = static_cast<double>(sound_gain_);
    const std::size_t window = observation.heard.size() / 2;
    // Sounds pause: the level is that of the whole second.  The side is that of the newest sound, heard since the last turns.
    const EarLevels second = ear_levels(observation.heard, window, gain);
    if (std::max(second.left_db, second.right_db) > kStopLevel_db) return m.last = Action::stop;
    now = ear_levels(observation.heard, std::min(window, 2 * observation.new_samples), gain);
  }
  const float ahead_m = clearance_m(observation.depth, 1.0 / 3, 2.0 / 3);
  const bool blocked = (observation.collided && m.last == Action::forward) || ahead_m < kNear_m;
  bool stuck = false;
  if (m.steps >= kPatience_steps) {
    stuck = std::hypot(m.x_m, m.z_m) < kProgress_m;
    if (!stuck) m.escapes = 0;
    m.steps = 0;
    m.x_m = m.z_m = 0;
    // Sound is diffracted around obstacles that an agent cannot cross: at times it follows the free space and not the louder ear.
    m.explores = random.uniform(1) < kExploration;
  }
  const int circle = turns_per_circle(task_);
  if (m.turns > 0) {  // turns on until the way is open, but not around more than once
    --m.turns;
    ++m.turned;
    if (m.turns == 0 && ahead_m < kOpen_m && m.turned < circle) m.turns = 1;
  } else if (blocked || stuck) {
    escape(observation, random);
  }
  const Action side = m.side > 0 ? Action::left : Action::right;
  if (m.turns > 0) return m.last = side;
  if (m.walk > 0) {
    --m.walk;
    return m.last = Action::forward;
  }
  m.side = 0;
  const double difference_db = now.left_db - now.right_db;
  if (!m.explores && std::max(now.left_db, now.right_db) > kSilence_db && std::abs(difference_db) > kTurnDifference_db)
    return m.last = difference_db > 0 ? Action::left : Action::right;
  return m.last = Action::forward;
}

}  // namespace earshot
