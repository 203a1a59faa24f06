// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/agent_senses.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>

#include "envs/task/bearing.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

bool same_pose(const Pose& a, const Pose& b) { return a.position == b.position && a.heading_rad == b.heading_rad; }

/// Of the draws of one step.
RandomStream random_of(const Agent& agent, Purpose purpose) {
  return {agent.noise_seed(), purpose, agent.stream, static_cast<std::uint32_t>(agent.episode_count),
          static_cast<std::uint32_t>(agent.state.steps())};
}

}  // namespace

void AgentSenses::move(const EnvRun& run, Agent& agent, Action action) const {
  const TaskConfig& task = setup_->config.task;
  const int lost_before = agent.state.lost_distances();
  agent.around.places.clear();
  for (const Agent& other : run.agents)
    if (&other != &agent) agent.around.places.push_back(other.state.pose(task).position);
  ActuationError error;
  if (task.actuation_noise.any()) error = draw_actuation_error(task.actuation_noise, action, random_of(agent, Purpose::actuation_noise));
  float reward = agent.state.step(task, agent.source->scene->navmesh, run.goal_of(agent), action, error, agent.around);
  const Pose pose = agent.state.pose(task);
  if (rows_->of(SensorKind::topdown_map) && pose.position != agent.path.back()) agent.path.push_back(pose.position);
  std::array<float, 4> place = {pose.position.x, pose.position.y, pose.position.z, static_cast<float>(pose.heading_rad)};
  // A distance that was lost has the value before it (AvNavState), which is a guess and no reward.
  const bool lost = agent.state.lost_distances() != lost_before;
  float distance_m = lost ? std::numeric_limits<float>::quiet_NaN() : agent.state.distance_to_goal_m();
  if (!faults_->check(agent, Fault::pose, place) || !faults_->check(agent, Fault::distance, std::span(&distance_m, 1)) ||
      !faults_->check(agent, Fault::reward, std::span(&reward, 1)))
    return;
  agent.outcome.reward = reward;
  agent.outcome.terminated = agent.state.terminated();
  agent.outcome.truncated = agent.state.truncated();
  agent.outcome.collided = agent.state.collided();
}

void AgentSenses::trace(Agent& agent, HearingEngines* engines, int block) const {
  if (!agent.runs() || !engines) return;
  agent.hearing.trace(*engines, agent.state.pose(setup_->config.task), setup_->config.task.ear_height_m, block);
}

void AgentSenses::synthesize(Agent& agent, HearingEngines* engines) const {
  if (!agent.runs() || !engines) return;
  std::function<void(std::span<float>)> show;
  if (faults_->has_hook()) show = [&](std::span<float> rir) { faults_->check(agent, Fault::rir, rir); };
  if (!agent.hearing.synthesize(*engines, agent.state.pose(setup_->config.task).heading_rad, show))
    FaultDesk::report(agent, Fault::rir, "the impulse response is not finite");
}

void AgentSenses::convolve(Agent& agent, HearingEngines* engines) const {
  if (!agent.runs() || !engines) return;
  const std::span<float> sound = rows_->of(SensorKind::waveform)->row<float>(agent.row);
  if (!agent.hearing.convolve(*engines, setup_->block_samples, sound, rows_->of(SensorKind::heard)->row<float>(agent.row)))
    FaultDesk::report(agent, Fault::sound, "the sound of this step is not finite");
  else if (faults_->has_hook())
    faults_->check(agent, Fault::sound, sound);
}

bool AgentSenses::fill_window(Agent& agent, HearingEngines& engines) const {
  return agent.hearing.fill_window(engines, setup_->block_samples, rows_->of(SensorKind::waveform)->row<float>(agent.row),
                                   rows_->of(SensorKind::heard)->row<float>(agent.row));
}

void AgentSenses::observe_start(const EnvRun& run, Agent& agent, HearingEngines* engines) const {
  trace(agent, engines, setup_->window_samples());
  synthesize(agent, engines);
  if (engines && agent.runs()) {
    if (!fill_window(agent, *engines))
      FaultDesk::report(agent, Fault::sound, "the sound before the first step is not finite");
    else if (faults_->has_hook())
      faults_->check(agent, Fault::sound, rows_->of(SensorKind::waveform)->row<float>(agent.row));
  }
  render(run, agent);
  observe(run, agent, engines);
}

void AgentSenses::see_others(const EnvRun& run, Agent& agent) const {
  const NavmeshConfig& body = setup_->config.navmesh;
  agent.others.clear();
  for (const Agent& other : run.agents)
    if (&other != &agent)
      agent.others.push_back({.foot = other.state.pose(setup_->config.task).position,
                              .radius_m = body.agent_radius_m,
                              .height_m = body.agent_height_m,
                              .color = body_color(other.number)});
}

void AgentSenses::render(const EnvRun& run, Agent& agent) const {
  if (!agent.runs() || cameras_.empty()) return;
  see_others(run, agent);
  const Pose now = agent.state.pose(setup_->config.task);
  const bool noisy = setup_->config.observation.depth_noise;  // which is another in each step
  if (!noisy && agent.pictures_are_current && same_pose(now, agent.rendered_pose) && agent.others == agent.rendered_others) return;
  const DepthNoiseDraw noise{.seed = agent.noise_seed(),
                             .env = agent.stream,
                             .episode = static_cast<std::uint32_t>(agent.episode_count),
                             .step = static_cast<std::uint32_t>(agent.state.steps())};
  const bool egl_draws = pictures_->draws();
  bool wants_egl = false;
  for (std::size_t camera = 0; camera < cameras_.size(); ++camera) {
    if (egl_draws && cameras_[camera].is_pinhole())
      wants_egl = true;
    else if (!draw_by_embree(agent, camera, now, noise))
      return;
  }
  if (wants_egl)
    agent.pictures_now = {.wanted = true,
                          .scene = agent.source->scene->scene,
                          .appearance = agent.appearance,
                          .pose = now,
                          .episode_index = agent.episode_index,
                          .noise = noise};
  agent.rendered_pose = now;
  agent.rendered_others = agent.others;
  agent.pictures_are_current = true;
}

/// False: a picture is not finite.
bool AgentSenses::draw_by_embree(Agent& agent, std::size_t index, const Pose& pose, const DepthNoiseDraw& noise) const {
  const AgentCamera& camera = cameras_[index];
  CameraImages images = camera.images_of(agent.row, false);
  const std::span<float> depth_row = images.depth;
  const bool noisy = setup_->config.observation.depth_noise && camera.depth;
  if (noisy) {
    agent.clean_depth.resize(depth_row.size());
    images.depth = agent.clean_depth;
  }
  camera.camera.render(*agent.source->scene->scene, agent.appearance.get(), pose, images, agent.others);
  if (noisy)
    add_depth_noise(setup_->config.observation.noise, camera.config(), noise_of_camera(noise, index), agent.clean_depth, depth_row);
  if (camera.depth && !faults_->check(agent, Fault::depth, depth_row)) return false;
  return !camera.normals || faults_->check(agent, Fault::depth, images.normals);
}

void AgentSenses::observe(const EnvRun& run, Agent& agent, HearingEngines* engines) const {
  if (!agent.runs()) return;
  if (rows_->of(SensorKind::spectrogram) || rows_->of(SensorKind::interaural)) observe_sound(agent, *engines);
  observe_way(agent);
  observe_goal(run, agent);
}

/// Features of the sound at the ears.
void AgentSenses::observe_sound(Agent& agent, HearingEngines& engines) const {
  SensorRows* const spectrogram = rows_->of(SensorKind::spectrogram);
  SensorRows* const interaural = rows_->of(SensorKind::interaural);
  const auto picture = spectrogram ? spectrogram->row<float>(agent.row) : std::span<float>{};
  const auto cells = interaural ? interaural->row<float>(agent.row) : std::span<float>{};
  const bool legacy = setup_->config.observation.legacy_spectrogram;
  if (legacy) {  // the new samples, then zeros (docs/reference/formats.md, section 6.2)
    const std::size_t samples = engines.window.size() / engines.num_channels, block = size_of(setup_->block_samples);
    const auto sound = rows_->of(SensorKind::waveform)->row<float>(agent.row);
    std::fill(engines.window.begin(), engines.window.end(), 0.f);
    for (std::size_t channel = 0; channel < engines.num_channels; ++channel)
      std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(channel * block), block,
                  engines.window.begin() + static_cast<std::ptrdiff_t>(channel * samples));
    engines.analyzer.analyze(engines.window, picture);
  }
  const auto heard = rows_->of(SensorKind::heard)->row<float>(agent.row);
  agent.hearing.analyze(engines, heard, legacy ? std::span<float>{} : picture, cells);
  if (spectrogram) faults_->check(agent, Fault::spectrogram, picture);
  if (interaural) faults_->check(agent, Fault::spectrogram, cells);
}

/// reading: metres ahead and to the right, radians, as gps_compass.
void AgentSenses::add_pose_noise(const Agent& agent, std::span<float> reading) const {
  const PoseNoiseConfig& noise = setup_->config.observation.pose_noise;
  const RandomStream random = random_of(agent, Purpose::pose_noise);
  const auto [ahead, right] = random.normal2(0);
  reading[0] += noise.position_m * ahead;
  reading[1] += noise.position_m * right;
  const double error_rad = static_cast<double>(noise.heading_deg * random.normal2(1)[0]) * std::numbers::pi / 180.0;
  reading[2] = static_cast<float>(std::remainder(static_cast<double>(reading[2]) + error_rad, 2.0 * std::numbers::pi));
}

/// Sensors of where the agent is and has been, and of what it did.
void AgentSenses::observe_way(Agent& agent) const {
  const std::size_t row = agent.row;
  const Pose now = agent.state.pose(setup_->config.task);
  if (SensorRows* pointgoal = rows_->of(SensorKind::pointgoal)) {
    const glm::dvec3 goal_position = setup_->set->episodes[agent.episode_index].goal_position;
    const glm::dvec3 toward = goal_position - agent.source->scene->scene->to_world(now.position);
    const auto goal = pointgoal->row<float>(row);
    goal[0] = static_cast<float>(std::hypot(toward.x, toward.z));
    goal[1] = static_cast<float>(bearing_rad(toward, now.heading_rad));
    faults_->check(agent, Fault::pointgoal, goal);
  }
  const glm::vec3 moved = now.position - agent.start_pose.position;
  std::array<float, 4> since_start{
      glm::dot(moved, forward_of(agent.start_pose.heading_rad)), glm::dot(moved, right_of(agent.start_pose.heading_rad)),
      static_cast<float>(std::remainder(now.heading_rad - agent.start_pose.heading_rad, 2.0 * std::numbers::pi)),
      static_cast<float>(agent.state.steps()) * setup_->config.task.step_time_s};
  if (setup_->config.observation.pose_noise.any()) add_pose_noise(agent, since_start);
  if (SensorRows* gps_compass = rows_->of(SensorKind::gps_compass))
    std::copy_n(since_start.begin(), 3, gps_compass->row<float>(row).begin());
  if (SensorRows* pose = rows_->of(SensorKind::pose)) std::copy_n(since_start.begin(), 4, pose->row<float>(row).begin());
  if (SensorRows* map = rows_->of(SensorKind::topdown_map))
    draw_topdown_map(setup_->config.observation.map, agent.source->scene->floor->of(agent.source->scene->navmesh),
                     {.position = now.position, .heading_rad = now.heading_rad, .path = agent.path, .goals = agent.goals},
                     map->row<std::uint8_t>(row));
  if (SensorRows* collision = rows_->of(SensorKind::collision)) collision->row<std::uint8_t>(row)[0] = agent.state.collided() ? 1 : 0;
  if (SensorRows* action = rows_->of(SensorKind::previous_action))
    action->row<std::int32_t>(row)[0] = agent.actions.empty() ? -1 : agent.actions.back();
}

/// Privileged sensors.
void AgentSenses::observe_goal(const EnvRun& run, Agent& agent) const {
  SensorRows* const oracle = rows_->of(SensorKind::oracle_action);
  SensorRows* const goal_state = rows_->of(SensorKind::goal_state);
  if (!oracle && !goal_state) return;
  const Pose now = agent.state.pose(setup_->config.task);
  const NearestGoal goal = run.goal_of(agent);
  if (oracle) oracle->row<std::int32_t>(agent.row)[0] = static_cast<std::int32_t>(oracle_action(setup_->config.task, goal, now));
  if (!goal_state) return;
  const glm::vec3 toward = goal.nearest(now.position).goal() - now.position;
  const auto state = goal_state->row<float>(agent.row);
  state[0] = agent.state.distance_to_goal_m();
  state[1] = std::hypot(toward.x, toward.z);
  state[2] = static_cast<float>(bearing_rad(toward, now.heading_rad));
  const auto corner = goal.next_corner(now.position);
  state[3] = corner ? static_cast<float>(bearing_rad(*corner - now.position, now.heading_rad)) : state[2];
  faults_->check(agent, Fault::pointgoal, state);
}

void AgentSenses::clear(Agent& agent) const {
  rows_->clear(agent.row);
  agent.pictures_now.wanted = false;
}

void AgentSenses::keep(Agent& agent) const {
  rows_->keep(agent.row);
  if (agent.pictures_now.wanted)  // the copy has come too early for what is not drawn yet
    agent.pictures_last = agent.pictures_now;
  else
    agent.pictures_last.wanted = false;
}

void AgentSenses::end_part(Agent& agent) const {
  keep(agent);
  clear(agent);
  agent.waits = true;
}

}  // namespace earshot
