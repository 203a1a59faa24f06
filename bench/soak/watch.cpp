// SPDX-License-Identifier: Apache-2.0
#include "bench/soak/watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <utility>

#include "envs/hearing/finite_values.h"
#include "sim/acoustics/core/arrival.h"
#include "sim/base/files.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr std::size_t kMaxExamples = 12;

/// Distances along the surface follow corners that stand a little off their vertices: a move may gain this much more than its length.
constexpr float kGeodesicSlackM = 0.05f;
/// An agent stands on the surface: within this of the bounds of its scene.
constexpr float kBoundsSlackM = 0.25f;

/// Index of the first value outside [low, high], NaN included; values.size() if there is none.
std::size_t first_outside(std::span<const float> values, float low, float high) {
  const auto found = std::ranges::find_if(values, [&](float value) { return !(value >= low && value <= high); });
  return static_cast<std::size_t>(found - values.begin());
}

double distance_to_source(const BatchedEnv& env, std::size_t row) {
  const int index = static_cast<int>(row);
  const glm::vec3 ear = env.agent(index).pose.position + glm::vec3(0, env.config().task.ear_height_m, 0);
  return static_cast<double>(glm::distance(ear, env.source(index).candidates.source()));
}

}  // namespace

SoakRows SoakRowCopy::take(const BatchedEnv& env, std::size_t row, bool ended) {
  const auto copy = [&](std::span<const float> all, std::vector<float>& env_rows) {
    const std::size_t size = all.size() / static_cast<std::size_t>(env.num_envs());
    env_rows.assign(all.begin() + static_cast<std::ptrdiff_t>(row * size), all.begin() + static_cast<std::ptrdiff_t>((row + 1) * size));
    return std::span<float>(env_rows);
  };
  return {.depth = copy(ended ? final_float_rows(env, "depth") : float_rows(env, "depth"), depth_),
          .spectrogram = copy(ended ? final_float_rows(env, "spectrogram") : float_rows(env, "spectrogram"), spectrogram_),
          .audiogoal = copy(ended ? std::span<const float>{} : float_rows(env, "waveform"), audiogoal_),
          .pointgoal = copy(ended ? final_float_rows(env, "pointgoal") : float_rows(env, "pointgoal"), pointgoal_),
          .reward = env.rewards()[row]};
}

void EpisodeHash::add(const SoakRows& rows) {
  for (const std::span<float> sensor : {rows.depth, rows.spectrogram, rows.audiogoal, rows.pointgoal})
    hash_ = hash64(std::as_bytes(sensor), hash_);
  hash_ = hash64(std::as_bytes(std::span(&rows.reward, 1)), hash_);
}

SoakWatch::SoakWatch(const std::vector<SoakScene>& scenes, const SoakEpisodes& episodes, const EnvConfig& config, int num_envs,
                     int keep_records, Tamper tamper)
    : scenes_(scenes),
      episodes_(episodes),
      config_(config),
      keep_records_(static_cast<std::size_t>(keep_records)),
      tamper_(std::move(tamper)),
      agents_(static_cast<std::size_t>(num_envs)) {
  examples_.reserve(kMaxExamples);
  records_.reserve(keep_records_);
}

void SoakWatch::check_start(const BatchedEnv& env) {
  for (std::size_t row = 0; row < agents_.size(); ++row) begin(env, row);
}

void SoakWatch::check(const BatchedEnv& env) {
  for (std::size_t row = 0; row < agents_.size(); ++row) {
    Agent& agent = agents_[row];
    if (!agent.active) continue;
    ++steps_;
    ++kinds_[static_cast<std::size_t>(scenes_[episodes_.episodes[agent.episode_index].scene].kind)].steps;
    const bool ended = env.terminated()[row] != 0 || env.truncated()[row] != 0;
    if (ended) {
      check(env, row, true, 0);
      const auto finished = std::ranges::find(env.finished(), static_cast<int>(row), &FinishedEpisode::env);
      keep(*finished, agent);
      begin(env, row);
    } else {
      const double distance_m = distance_to_source(env, row), before_m = std::exchange(agent.distance_m, distance_m);
      check(env, row, false, std::min(distance_m, before_m));
    }
  }
}

void SoakWatch::begin(const BatchedEnv& env, std::size_t row) {
  Agent& agent = agents_[row];
  const int index = static_cast<int>(row);
  agent.active = env.active()[row] != 0;
  agent.hash.begin();
  if (!agent.active) return;
  agent.episode_index = env.agent(index).episode_index;
  agent.episode_count = env.agent(index).episode_count;
  agent.distance_m = distance_to_source(env, row);
  const EnvSource& source = env.source(index);
  agent.diffuse_energy =
      diffuse_field_energy(scenes_[episodes_.episodes[agent.episode_index].scene], *source.scene, source.candidates.source());
  check(env, row, false, agent.distance_m);
}

void SoakWatch::check(const BatchedEnv& env, std::size_t row, bool ended, double nearest_m) {
  SoakRows rows = copy_.take(env, row, ended);
  // A row that begins an episode in the step that ended another carries that one's reward.
  if (!ended && env.agent(static_cast<int>(row)).episode_step == 0) rows.reward = 0;
  if (tamper_) tamper_(steps_, static_cast<int>(row), rows);
  agents_[row].hash.add(rows);

  struct Sensor {
    const char* name;
    std::span<const float> values;
    float low, high;
  };
  constexpr float kHuge = std::numeric_limits<float>::max(), kPi = std::numbers::pi_v<float>;
  const TaskConfig& task = config_.task;
  const float reward_limit = std::abs(task.step_reward) + task.success_reward + task.distance_reward * (task.forward_m + kGeodesicSlackM);
  const auto pointgoal = std::span<const float>(rows.pointgoal);
  for (const Sensor& sensor :
       {Sensor{"depth", rows.depth, 0.f, 1.f}, Sensor{"spectrogram", rows.spectrogram, 0.f, kHuge},
        Sensor{"audiogoal", rows.audiogoal, -kHuge, kHuge}, Sensor{"distance to the goal", pointgoal.first(1), 0.f, kHuge},
        Sensor{"bearing of the goal", pointgoal.last(1), -kPi, kPi},
        Sensor{"reward", std::span(&rows.reward, 1), -reward_limit, reward_limit}}) {
    const std::size_t at = first_outside(sensor.values, sensor.low, sensor.high);
    if (at == sensor.values.size()) continue;
    report(all_finite(sensor.values) ? SoakFault::out_of_range : SoakFault::not_finite,
           fmt::format("{} is {} at {}: {}", sensor.name, sensor.values[at], at, place_of(env, row, ended)));
  }
  largest_reward_ = std::max(largest_reward_, std::abs(static_cast<double>(rows.reward)));
  if (ended) return;  // pose, source and sound are those of the next episode
  check_place(env, row);
  check_loudness(env, row, rows.audiogoal, nearest_m);
}

void SoakWatch::check_place(const BatchedEnv& env, std::size_t row) {
  const glm::vec3 foot = env.agent(static_cast<int>(row)).pose.position;
  const Bounds& bounds = env.source(static_cast<int>(row)).scene->scene->bounds();
  for (int axis = 0; axis < 3; ++axis)
    if (!(foot[axis] >= bounds.lower[axis] - kBoundsSlackM && foot[axis] <= bounds.upper[axis] + kBoundsSlackM)) {
      report(SoakFault::out_of_the_scene, place_of(env, row, false));
      return;
    }
}

void SoakWatch::check_loudness(const BatchedEnv& env, std::size_t row, std::span<const float> sound, double nearest_m) {
  const SoakEpisode& episode = episodes_.episodes[agents_[row].episode_index];
  const double distance_m = std::max(nearest_m, static_cast<double>(kMinDistanceM));
  const double direct_pressure = 1 / (4 * std::numbers::pi * distance_m);
  const double expected = episode.dry_mean_square * (direct_pressure * direct_pressure + agents_[row].diffuse_energy);
  const std::size_t samples = sound.size() / 2;
  for (std::size_t ear = 0; ear < 2; ++ear) {
    double squares = 0;
    for (const float value : sound.subspan(ear * samples, samples)) squares += static_cast<double>(value) * static_cast<double>(value);
    const double ratio = squares / static_cast<double>(samples) / expected;
    loudness_.add(ratio);
    auto& loudest = kinds_[static_cast<std::size_t>(scenes_[episode.scene].kind)].loudest;
    loudest = std::max(loudest, ratio);
    if (ratio > kLoudnessMargin)
      report(SoakFault::too_loud, fmt::format("{} ear: {:.1f} dB over the free field at {:.2f} m and the diffuse field: {}",
                                              ear == 0 ? "left" : "right", 10 * std::log10(ratio), nearest_m, place_of(env, row, false)));
  }
}

std::string SoakWatch::place_of(const BatchedEnv& env, std::size_t row, bool ended) const {
  const int index = static_cast<int>(row);
  const Episode& episode = episodes_.set.episodes[agents_[row].episode_index];
  const std::string where = fmt::format("scene {}, episode {} of the set, env {}, its episode {}, sound {}, seed {}", episode.scene_id,
                                        agents_[row].episode_index, index, agents_[row].episode_count, episode.sound, config_.seed);
  if (ended) return where + ", last step";
  const Pose pose = env.agent(index).pose;
  return where + fmt::format(", step {}, position {} {} {}, heading {:.4f} rad", env.agent(index).episode_step, pose.position.x,
                             pose.position.y, pose.position.z, pose.heading_rad);
}

void SoakWatch::report(SoakFault fault, const std::string& problem) {
  ++faults_[static_cast<std::size_t>(fault)];
  if (examples_.size() < kMaxExamples) examples_.push_back({fault, problem});
}

void SoakWatch::keep(const FinishedEpisode& finished, const Agent& agent) {
  ++num_finished_;
  ++kinds_[static_cast<std::size_t>(scenes_[episodes_.episodes[agent.episode_index].scene].kind)].episodes;
  if (finished.metrics.success > 0) ++successes_;
  if (keep_records_ == 0) return;
  std::size_t record = records_.size();
  if (record == keep_records_) {
    record = RandomStream(config_.seed, Purpose::bench, 0xFFFFFFFFu)
                 .below(static_cast<std::uint32_t>(num_finished_), static_cast<std::uint32_t>(num_finished_));
    if (record >= keep_records_) return;
  } else {
    records_.emplace_back();
  }
  records_[record] = {.env = finished.env,
                      .episode_index = finished.episode_index,
                      .episode_count = agent.episode_count,
                      .actions = finished.actions,
                      .hash = agent.hash.value()};
}

}  // namespace earshot
