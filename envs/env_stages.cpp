#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "envs/batched_env_impl.h"

namespace earshot {
namespace {

bool same_pose(const Pose& a, const Pose& b) { return a.position == b.position && a.heading_rad == b.heading_rad; }

}  // namespace

void BatchedEnv::Impl::move(std::size_t env, Action action) {
  rewards[env] = 0.f;
  terminated[env] = truncated[env] = collided[env] = quarantined[env] = 0;
  if (!active[env]) return;
  Agent& agent = agents[env];
  agent.actions.push_back(static_cast<std::int8_t>(action));
  const int lost_before = agent.state.lost_distances();
  float reward = agent.state.step(config.task, agent.source->scene->navmesh, agent.source->field, action);
  const Pose pose = agent.state.pose(config.task);
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

void BatchedEnv::Impl::trace(std::size_t env) {
  if (!runs(env) || !config.observation.spectrogram) return;
  agents[env].hearing.trace(*agents[env].source, agents[env].state.pose(config.task), config.task.ear_height_m);
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
  if (!agents[env].hearing.convolve(*own, block_samples, sound_row(audiogoal, env), sound_row(heard, env)))
    report(env, Fault::sound, "the sound of this step is not finite");
  else if (hook)
    check(env, Fault::sound, sound_row(audiogoal, env));
}

void BatchedEnv::Impl::render(std::size_t env) {
  if (!runs(env) || !config.observation.depth) return;
  Agent& agent = agents[env];
  const Pose pose = agent.state.pose(config.task);
  if (agent.depth_is_current && same_pose(pose, agent.rendered_pose)) return;
  renderer.render_depth(*agent.source->scene->scene, pose, depth.row(env));
  if (!check(env, Fault::depth, depth.row(env))) return;
  agent.rendered_pose = pose;
  agent.depth_is_current = true;
}

void BatchedEnv::Impl::observe(std::size_t env, HearingEngines* own) {
  if (!runs(env)) return;
  if (own) {
    if (config.observation.legacy_spectrogram) {  // the new samples, then zeros (docs/formats.md, section 6.2)
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
    check(env, Fault::spectrogram, spectrogram.row(env));
  }
  if (config.observation.pointgoal) {
    const Pose pose = agents[env].state.pose(config.task);
    const glm::dvec3 toward = episode_of(agents[env]).goal_position - agents[env].source->scene->scene->to_world(pose.position);
    const double bearing_rad = std::atan2(-toward.x, -toward.z);  // forward_of(h) = (-sin h, 0, -cos h)
    pointgoal.row(env)[0] = static_cast<float>(std::hypot(toward.x, toward.z));
    pointgoal.row(env)[1] = static_cast<float>(std::remainder(bearing_rad - pose.heading_rad, 2.0 * std::numbers::pi));
    check(env, Fault::pointgoal, pointgoal.row(env));
  }
}

}  // namespace earshot
