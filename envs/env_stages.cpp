#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "envs/batched_env_impl.h"

namespace earshot {
namespace {

bool same_pose(const Pose& a, const Pose& b) { return a.position == b.position && a.heading_rad == b.heading_rad; }

}  // namespace

void BatchedEnv::Impl::move(std::size_t env, Action action) {
  rewards[env] = 0.f;
  terminated[env] = truncated[env] = collided[env] = 0;
  if (!active[env]) return;
  Agent& agent = agents[env];
  const int lost_before = agent.state.lost_distances();
  float reward = agent.state.step(config.task, agent.source->scene->navmesh, agent.source->field, action);
  if (agent.state.lost_distances() != lost_before) report_nonfinite(env, "distance to the goal");
  if (!std::isfinite(reward)) {
    report_nonfinite(env, "reward");
    reward = 0.f;
  }
  agent.actions.push_back(static_cast<std::int8_t>(action));
  rewards[env] = reward;
  terminated[env] = agent.state.terminated();
  truncated[env] = agent.state.truncated();
  collided[env] = agent.state.collided();
}

void BatchedEnv::Impl::trace(std::size_t env) {
  if (!active[env] || !config.observation.spectrogram) return;
  agents[env].hearing.trace(*agents[env].source, agents[env].state.pose(config.task), config.task.ear_height_m);
}

void BatchedEnv::Impl::synthesize(std::size_t env, HearingEngines* own) {
  if (!active[env] || !own) return;
  agents[env].hearing.synthesize(*own, agents[env].state.pose(config.task).heading_rad);
}

void BatchedEnv::Impl::convolve(std::size_t env, HearingEngines* own) {
  if (!active[env] || !own) return;
  if (!agents[env].hearing.convolve(*own, block_samples, sound_row(audiogoal, env), sound_row(heard, env))) report_nonfinite(env, "sound");
}

void BatchedEnv::Impl::render(std::size_t env) {
  if (!active[env] || !config.observation.depth) return;
  Agent& agent = agents[env];
  const Pose pose = agent.state.pose(config.task);
  if (agent.depth_is_current && same_pose(pose, agent.rendered_pose)) return;
  renderer.render_depth(*agent.source->scene->scene, pose, depth.row(env));
  clear_if_nonfinite(env, depth, "depth");
  agent.rendered_pose = pose;
  agent.depth_is_current = true;
}

void BatchedEnv::Impl::observe(std::size_t env, HearingEngines* own) {
  if (!active[env]) return;
  if (own) {
    if (config.observation.legacy_spectrogram) {  // the new samples, then zeros (FACTS 2.3, step 7)
      const std::size_t samples = own->window.size() / 2, block = size_of(block_samples);
      const auto sound = sound_row(audiogoal, env);
      std::fill(own->window.begin(), own->window.end(), 0.f);
      for (std::size_t ear = 0; ear < 2; ++ear)
        std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(ear * block), block,
                    own->window.begin() + static_cast<std::ptrdiff_t>(ear * samples));
      own->analyzer.analyze(own->window, spectrogram.row(env));
    } else {
      agents[env].hearing.analyze(*own, sound_row(heard, env), spectrogram.row(env));
    }
    clear_if_nonfinite(env, spectrogram, "spectrogram");
  }
  if (config.observation.pointgoal) {
    const Pose pose = agents[env].state.pose(config.task);
    const glm::dvec3 toward = episode_of(agents[env]).goal_position - agents[env].source->scene->scene->to_world(pose.position);
    const double bearing_rad = std::atan2(-toward.x, -toward.z);  // forward_of(h) = (-sin h, 0, -cos h)
    pointgoal.row(env)[0] = static_cast<float>(std::hypot(toward.x, toward.z));
    pointgoal.row(env)[1] = static_cast<float>(std::remainder(bearing_rad - pose.heading_rad, 2.0 * std::numbers::pi));
    clear_if_nonfinite(env, pointgoal, "pointgoal");
  }
}

void BatchedEnv::Impl::report_nonfinite(std::size_t env, const char* what) {
  if (nonfinite_events.fetch_add(1) > 0) return;
  const Agent& agent = agents[env];
  const Pose pose = agent.state.pose(config.task);
  spdlog::error(
      "{} is not finite and was set to zero (further cases are counted only): scene {}, episode '{}', step {}, position {} {} {}, heading "
      "{} rad, "
      "env {}, seed {}",
      what, episode_of(agent).scene_id, episode_of(agent).episode_id, agent.state.steps(), pose.position.x, pose.position.y,
      pose.position.z, pose.heading_rad, global_id(env), config.seed);
}

void BatchedEnv::Impl::clear_if_nonfinite(std::size_t env, SensorRows& sensor, const char* what) {
  if (all_finite(sensor.row(env))) return;
  sensor.clear(env);
  report_nonfinite(env, what);
}

}  // namespace earshot
