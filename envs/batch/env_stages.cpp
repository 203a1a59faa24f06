#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <utility>

#include "envs/batch/batched_env_impl.h"
#include "envs/task/bearing.h"
#include "sim/base/random.h"

namespace earshot {

void BatchedEnv::Impl::clear_outcome(std::size_t env) {
  for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row) rows.clear_outcome(row);
}

void BatchedEnv::Impl::move(std::size_t row, Action action) {
  Agent& agent = agents[row];
  const int lost_before = agent.state.lost_distances();
  agent.around.places.clear();
  for (const Agent& other : agents_of(env_of(row)))
    if (&other != &agent) agent.around.places.push_back(other.state.pose(config.task).position);
  ActuationError error;
  if (config.task.actuation_noise.any())
    error = draw_actuation_error(
        config.task.actuation_noise, action,
        RandomStream(noise_seed(row), Purpose::actuation_noise, agent.stream, static_cast<std::uint32_t>(agent.episode_count),
                     static_cast<std::uint32_t>(agent.state.steps())));
  float reward = agent.state.step(config.task, agent.source->scene->navmesh, goal_of(row), action, error, agent.around);
  const Pose pose = agent.state.pose(config.task);
  if (rows.of(SensorKind::topdown_map) && pose.position != agent.path.back()) agent.path.push_back(pose.position);
  std::array<float, 4> place = {pose.position.x, pose.position.y, pose.position.z, static_cast<float>(pose.heading_rad)};
  // A distance that was lost has the value before it (AvNavState), which is a guess and no reward.
  const bool lost = agent.state.lost_distances() != lost_before;
  float distance_m = lost ? std::numeric_limits<float>::quiet_NaN() : agent.state.distance_to_goal_m();
  if (!check(row, Fault::pose, place) || !check(row, Fault::distance, std::span(&distance_m, 1)) ||
      !check(row, Fault::reward, std::span(&reward, 1)))
    return;
  agent.outcome.reward = reward;
  agent.outcome.terminated = agent.state.terminated();
  agent.outcome.truncated = agent.state.truncated();
  agent.outcome.collided = agent.state.collided();
}

void BatchedEnv::Impl::move_sounds(std::size_t env, HearingEngines* own) {
  EnvRun& run = envs[env];
  if (!own || run.sounds.empty()) return;
  const std::size_t window = size_of(config.observation.sound.num_samples), block = size_of(block_samples);
  const std::uint64_t last = window + size_of(run.steps) * block;  // sample at which the step ends
  const auto move_one = [&](EnvSound& sound) {
    if (!sound.moving) return;
    const int new_samples = run.steps == 0 ? static_cast<int>(window) : block_samples;
    PlayedSound now = sound.played;
    now.position.sample = last - static_cast<std::uint64_t>(new_samples);
    if (!sounds_within(now, size_of(own->max_rir_samples), new_samples)) return;
    if (sound.agent < 0)
      sound.moving->move_to(sound.moving->place_at(static_cast<double>(last)));
    else
      sound.moving->move_to(agents[first_row(env) + size_of(sound.agent)].state.pose(config.task).position +
                            glm::vec3(0, config.task.source_height_m, 0));
  };
  if (AgentTeam* team = run.team.get())
    team->run(run.sounds.size(), [&](std::size_t i, std::size_t) {
      try {
        move_one(run.sounds[i]);
      } catch (...) {
        run.sounds[i].error = std::current_exception();
      }
    });
  else
    for (EnvSound& sound : run.sounds) move_one(sound);
  for (EnvSound& sound : run.sounds)
    if (sound.error) std::rethrow_exception(std::exchange(sound.error, nullptr));
}

void BatchedEnv::Impl::trace(std::size_t row, HearingEngines* own, int block) {
  if (!runs(row) || !own) return;
  agents[row].hearing.trace(*own, agents[row].state.pose(config.task), config.task.ear_height_m, block);
}

void BatchedEnv::Impl::synthesize(std::size_t row, HearingEngines* own) {
  if (!runs(row) || !own) return;
  std::function<void(std::span<float>)> show;
  if (hook) show = [&](std::span<float> rir) { check(row, Fault::rir, rir); };
  if (!agents[row].hearing.synthesize(*own, agents[row].state.pose(config.task).heading_rad, show))
    report(row, Fault::rir, "the impulse response is not finite");
}

void BatchedEnv::Impl::convolve(std::size_t row, HearingEngines* own) {
  if (!runs(row) || !own) return;
  if (!agents[row].hearing.convolve(*own, block_samples, rows.of(SensorKind::waveform)->row<float>(row),
                                    rows.of(SensorKind::heard)->row<float>(row)))
    report(row, Fault::sound, "the sound of this step is not finite");
  else if (hook)
    check(row, Fault::sound, rows.of(SensorKind::waveform)->row<float>(row));
}

void BatchedEnv::Impl::observe(std::size_t row, HearingEngines* own) {
  if (!runs(row)) return;
  SensorRows* const spectrogram = rows.of(SensorKind::spectrogram);
  SensorRows* const interaural = rows.of(SensorKind::interaural);
  const auto cells = interaural ? interaural->row<float>(row) : std::span<float>{};
  if (spectrogram || interaural) {
    const auto picture = spectrogram ? spectrogram->row<float>(row) : std::span<float>{};
    if (config.observation.legacy_spectrogram) {  // the new samples, then zeros (docs/formats.md, section 6.2)
      const std::size_t samples = own->window.size() / 2, block = size_of(block_samples);
      const auto sound = rows.of(SensorKind::waveform)->row<float>(row);
      std::fill(own->window.begin(), own->window.end(), 0.f);
      for (std::size_t ear = 0; ear < 2; ++ear)
        std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(ear * block), block,
                    own->window.begin() + static_cast<std::ptrdiff_t>(ear * samples));
      own->analyzer.analyze(own->window, picture);
    }
    agents[row].hearing.analyze(*own, rows.of(SensorKind::heard)->row<float>(row),
                                config.observation.legacy_spectrogram ? std::span<float>{} : picture, cells);
    if (spectrogram) check(row, Fault::spectrogram, picture);
    if (interaural) check(row, Fault::spectrogram, cells);
  }
  observe_way(row);
  observe_goal(row);
}

/// reading: metres ahead and to the right, radians, as gps_compass.
void BatchedEnv::Impl::add_pose_noise(std::size_t row, std::span<float> reading) const {
  const Agent& agent = agents[row];
  const PoseNoiseConfig& noise = config.observation.pose_noise;
  const RandomStream random(noise_seed(row), Purpose::pose_noise, agent.stream, static_cast<std::uint32_t>(agent.episode_count),
                            static_cast<std::uint32_t>(agent.state.steps()));
  const auto [ahead, right] = random.normal2(0);
  reading[0] += noise.position_m * ahead;
  reading[1] += noise.position_m * right;
  const double error_rad = static_cast<double>(noise.heading_deg * random.normal2(1)[0]) * std::numbers::pi / 180.0;
  reading[2] = static_cast<float>(std::remainder(static_cast<double>(reading[2]) + error_rad, 2.0 * std::numbers::pi));
}

/// Sensors of where the agent is and has been, and of what it did.
void BatchedEnv::Impl::observe_way(std::size_t row) {
  const Agent& agent = agents[row];
  const Pose now = agent.state.pose(config.task);
  if (SensorRows* pointgoal = rows.of(SensorKind::pointgoal)) {
    const glm::dvec3 toward = episode_of(agent).goal_position - agent.source->scene->scene->to_world(now.position);
    const auto goal = pointgoal->row<float>(row);
    goal[0] = static_cast<float>(std::hypot(toward.x, toward.z));
    goal[1] = static_cast<float>(bearing_rad(toward, now.heading_rad));
    check(row, Fault::pointgoal, goal);
  }
  const glm::vec3 moved = now.position - agent.start_pose.position;
  std::array<float, 4> since_start{
      glm::dot(moved, forward_of(agent.start_pose.heading_rad)), glm::dot(moved, right_of(agent.start_pose.heading_rad)),
      static_cast<float>(std::remainder(now.heading_rad - agent.start_pose.heading_rad, 2.0 * std::numbers::pi)),
      static_cast<float>(agent.state.steps()) * config.task.step_time_s};
  if (config.observation.pose_noise.any()) add_pose_noise(row, since_start);
  if (SensorRows* gps_compass = rows.of(SensorKind::gps_compass)) std::copy_n(since_start.begin(), 3, gps_compass->row<float>(row).begin());
  if (SensorRows* pose = rows.of(SensorKind::pose)) std::copy_n(since_start.begin(), 4, pose->row<float>(row).begin());
  if (SensorRows* topdown_map = rows.of(SensorKind::topdown_map))
    draw_topdown_map(config.observation.map, agent.source->scene->floor->of(agent.source->scene->navmesh),
                     {.position = now.position, .heading_rad = now.heading_rad, .path = agent.path, .goals = agent.goals},
                     topdown_map->row<std::uint8_t>(row));
  if (SensorRows* collision = rows.of(SensorKind::collision)) collision->row<std::uint8_t>(row)[0] = agent.state.collided() ? 1 : 0;
  if (SensorRows* previous_action = rows.of(SensorKind::previous_action))
    previous_action->row<std::int32_t>(row)[0] = agent.actions.empty() ? -1 : agent.actions.back();
}

/// What no agent could sense.
void BatchedEnv::Impl::observe_goal(std::size_t row) {
  SensorRows* const oracle_action_rows = rows.of(SensorKind::oracle_action);
  SensorRows* const goal_state = rows.of(SensorKind::goal_state);
  if (!oracle_action_rows && !goal_state) return;
  const Agent& agent = agents[row];
  const Pose now = agent.state.pose(config.task);
  const NearestGoal goal = goal_of(row);
  if (oracle_action_rows) oracle_action_rows->row<std::int32_t>(row)[0] = static_cast<std::int32_t>(oracle_action(config.task, goal, now));
  if (!goal_state) return;
  const glm::vec3 toward = goal.nearest(now.position).goal() - now.position;
  const auto state = goal_state->row<float>(row);
  state[0] = agent.state.distance_to_goal_m();
  state[1] = std::hypot(toward.x, toward.z);
  state[2] = static_cast<float>(bearing_rad(toward, now.heading_rad));
  const auto corner = goal.next_corner(now.position);
  state[3] = corner ? static_cast<float>(bearing_rad(*corner - now.position, now.heading_rad)) : state[2];
  check(row, Fault::pointgoal, state);
}

}  // namespace earshot
