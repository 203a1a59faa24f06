#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "envs/batched_env_impl.h"
#include "sim/base/random.h"

namespace earshot {
void BatchedEnv::Impl::clear_outcome(std::size_t env) {
  rewards[env] = 0.f;
  terminated[env] = truncated[env] = collided[env] = quarantined[env] = 0;
}

void BatchedEnv::Impl::move(std::size_t env, Action action) {
  Agent& agent = agents[env];
  agent.actions.push_back(static_cast<std::int8_t>(action));
  const int lost_before = agent.state.lost_distances();
  ActuationError error;
  if (config.task.actuation_noise.any())
    error = draw_actuation_error(
        config.task.actuation_noise, action,
        RandomStream(agent.seed, Purpose::actuation_noise, agent.stream, static_cast<std::uint32_t>(agent.episode_count),
                     static_cast<std::uint32_t>(agent.state.steps())));
  float reward = agent.state.step(config.task, agent.source->scene->navmesh, goal_of(agent), action, error);
  const Pose pose = agent.state.pose(config.task);
  if (topdown_map && pose.position != agent.path.back()) agent.path.push_back(pose.position);
  std::array<float, 4> place = {pose.position.x, pose.position.y, pose.position.z, static_cast<float>(pose.heading_rad)};
  // A distance that was lost has the value before it (AvNavState), which is a guess and no reward.
  const bool lost = agent.state.lost_distances() != lost_before;
  float distance_m = lost ? std::numeric_limits<float>::quiet_NaN() : agent.state.distance_to_goal_m();
  if (!check(env, Fault::pose, place) || !check(env, Fault::distance, std::span(&distance_m, 1)) ||
      !check(env, Fault::reward, std::span(&reward, 1)))
    return;
  rewards[env] = reward;
  terminated[env] = agent.state.terminated();
  truncated[env] = agent.state.truncated();
  collided[env] = agent.state.collided();
}

void BatchedEnv::Impl::trace(std::size_t env, HearingEngines* own, int block) {
  if (!runs(env) || !own) return;
  agents[env].hearing.trace(*own, agents[env].state.pose(config.task), config.task.ear_height_m, block);
}

void BatchedEnv::Impl::synthesize(std::size_t env, HearingEngines* own) {
  if (!runs(env) || !own) return;
  std::function<void(std::span<float>)> show;
  if (hook) show = [&](std::span<float> rir) { check(env, Fault::rir, rir); };
  if (!agents[env].hearing.synthesize(*own, agents[env].state.pose(config.task).heading_rad, show))
    report(env, Fault::rir, "the impulse response is not finite");
}

void BatchedEnv::Impl::convolve(std::size_t env, HearingEngines* own) {
  if (!runs(env) || !own) return;
  if (!agents[env].hearing.convolve(*own, block_samples, waveform->row<float>(env), heard->row<float>(env)))
    report(env, Fault::sound, "the sound of this step is not finite");
  else if (hook)
    check(env, Fault::sound, waveform->row<float>(env));
}

void BatchedEnv::Impl::observe(std::size_t env, HearingEngines* own) {
  if (!runs(env)) return;
  if (spectrogram) {
    const auto row = spectrogram->row<float>(env);
    if (config.observation.legacy_spectrogram) {  // the new samples, then zeros (docs/formats.md, section 6.2)
      const std::size_t samples = own->window.size() / 2, block = size_of(block_samples);
      const auto sound = waveform->row<float>(env);
      std::fill(own->window.begin(), own->window.end(), 0.f);
      for (std::size_t ear = 0; ear < 2; ++ear)
        std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(ear * block), block,
                    own->window.begin() + static_cast<std::ptrdiff_t>(ear * samples));
      own->analyzer.analyze(own->window, row);
    } else {
      agents[env].hearing.analyze(*own, heard->row<float>(env), row);
    }
    check(env, Fault::spectrogram, row);
  }
  observe_way(env);
}

/// reading: metres ahead and to the right, radians, as gps_compass.
void BatchedEnv::Impl::add_pose_noise(const Agent& agent, std::span<float> reading) const {
  const PoseNoiseConfig& noise = config.observation.pose_noise;
  const RandomStream random(agent.seed, Purpose::pose_noise, agent.stream, static_cast<std::uint32_t>(agent.episode_count),
                            static_cast<std::uint32_t>(agent.state.steps()));
  const auto [ahead, right] = random.normal2(0);
  reading[0] += noise.position_m * ahead;
  reading[1] += noise.position_m * right;
  const double error_rad = static_cast<double>(noise.heading_deg * random.normal2(1)[0]) * std::numbers::pi / 180.0;
  reading[2] = static_cast<float>(std::remainder(static_cast<double>(reading[2]) + error_rad, 2.0 * std::numbers::pi));
}

/// Sensors of where the agent is and has been, and of what it did.
void BatchedEnv::Impl::observe_way(std::size_t env) {
  const Agent& agent = agents[env];
  const Pose now = agent.state.pose(config.task);
  if (pointgoal) {
    const glm::dvec3 toward = episode_of(agent).goal_position - agent.source->scene->scene->to_world(now.position);
    const double bearing_rad = std::atan2(-toward.x, -toward.z);  // forward_of(h) = (-sin h, 0, -cos h)
    const auto row = pointgoal->row<float>(env);
    row[0] = static_cast<float>(std::hypot(toward.x, toward.z));
    row[1] = static_cast<float>(std::remainder(bearing_rad - now.heading_rad, 2.0 * std::numbers::pi));
    check(env, Fault::pointgoal, row);
  }
  const glm::vec3 moved = now.position - agent.start_pose.position;
  std::array<float, 4> since_start{
      glm::dot(moved, forward_of(agent.start_pose.heading_rad)), glm::dot(moved, right_of(agent.start_pose.heading_rad)),
      static_cast<float>(std::remainder(now.heading_rad - agent.start_pose.heading_rad, 2.0 * std::numbers::pi)),
      static_cast<float>(agent.state.steps()) * config.task.step_time_s};
  if (config.observation.pose_noise.any()) add_pose_noise(agent, since_start);
  if (gps_compass) std::copy_n(since_start.begin(), 3, gps_compass->row<float>(env).begin());
  if (way) std::copy_n(since_start.begin(), 4, way->row<float>(env).begin());
  if (topdown_map)
    draw_topdown_map(config.observation.map, agent.source->scene->floor->of(agent.source->scene->navmesh),
                     {.position = now.position, .heading_rad = now.heading_rad, .path = agent.path, .goals = agent.goals},
                     topdown_map->row<std::uint8_t>(env));
  if (collision) collision->row<std::uint8_t>(env)[0] = agent.state.collided() ? 1 : 0;
  if (previous_action) previous_action->row<std::int32_t>(env)[0] = agent.actions.empty() ? -1 : agent.actions.back();
}

}  // namespace earshot
