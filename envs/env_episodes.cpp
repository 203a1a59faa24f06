#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <optional>

#include "envs/batched_env_impl.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// How many other episodes an env tries when one has no path to its goal.
constexpr std::uint32_t kMaxDraws = 64;

}  // namespace

void BatchedEnv::Impl::restart(std::size_t env, HearingEngines* own) {
  if (!ended(env)) return;
  for (SensorRows* sensor : {&depth, &spectrogram, &pointgoal}) sensor->keep(env);
  begin_next_episode(env);
  observe_start(env, own);
}

std::optional<std::uint64_t> BatchedEnv::Impl::draw_episode(std::size_t env, int episode_count, std::uint32_t attempt) const {
  const std::uint64_t num_episodes = set->episodes.size();
  const auto count = static_cast<std::uint32_t>(episode_count);
  if (config.order == EpisodeOrder::random)
    return RandomStream(config.seed, Purpose::episode_order, global_id(env), count, attempt)
        .below(static_cast<std::uint32_t>(num_episodes), 0);
  const std::uint64_t index = global_id(env) + std::uint64_t{count} * static_cast<std::uint64_t>(total_envs);
  return index < num_episodes ? std::optional(index) : std::nullopt;
}

void BatchedEnv::Impl::begin_next_episode(std::size_t env) {
  const int count = agents[env].episode_count + 1;
  for (std::uint32_t attempt = 0; attempt < kMaxDraws; ++attempt) {
    const auto index = draw_episode(env, count, attempt);
    if (!index) return go_idle(env);
    if (begin_episode(env, *index, count)) {
      if (const auto next = draw_episode(env, count + 1, 0); next && config.prefetch) {
        const Episode& episode = set->episodes[*next];
        scenes->prefetch(episode.scene_id, episode.goal_position, config.task.source_height_m);
      }
      return;
    }
    const Episode& episode = set->episodes[*index];
    if (config.order == EpisodeOrder::once)
      throw InputError("episode '" + episode.episode_id + "' in " + episode.scene_id, "no walkable path leads from its start to its goal",
                       "remove it from the set, or make the set again for this scene and agent size");
    if (skipped_episodes.fetch_add(1) == 0)
      spdlog::warn("episode '{}' in {} is passed over, as will be all like it: no walkable path leads to its goal", episode.episode_id,
                   episode.scene_id);
  }
  throw InputError("episode set", fmt::format("{} episodes in a row have no walkable path to their goal", kMaxDraws),
                   "make the set again for these scenes and this agent size");
}

bool BatchedEnv::Impl::begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count) {
  Agent& agent = agents[env];
  const Episode& episode = set->episodes[episode_index];
  const TaskConfig& task = config.task;
  try {
    agent.source = scenes->source(episode.scene_id, episode.goal_position, task.source_height_m);
  } catch (const InputError& error) {
    throw InputError("episode '" + episode.episode_id + "'", error.what(), "");
  }
  const Navmesh& navmesh = agent.source->scene->navmesh;
  const GeodesicField& field = agent.source->field;
  const auto start = navmesh.snap(agent.source->scene->scene->to_local(episode.start_position));
  if (!start || !field.distance_m(*start)) return false;
  const double heading_rad = heading_of(episode.start_rotation);
  // Counted here and not read from the file: published sets count 1 m steps and 90 degree turns (FACTS 2.5).
  const auto oracle_actions = count_oracle_actions(task, navmesh, field, *start, heading_rad);
  agent.state.begin(task, field, *start, heading_rad, oracle_actions.value_or(episode.num_action));
  agent.episode_index = episode_index;
  agent.episode_count = episode_count;
  agent.depth_is_current = false;
  agent.actions.clear();
  agent.actions.reserve(size_of(task.max_steps));
  if (config.observation.spectrogram) {
    const SoundClip& clip = sounds.clip(episode.sound);
    const RandomStream random(config.seed, Purpose::sound, global_id(env), static_cast<std::uint32_t>(episode_count));
    agent.hearing.begin(*agent.source, clip, random.below(static_cast<std::uint32_t>(clip.samples.size()), 0));
  }
  active[env] = 1;
  return true;
}

void BatchedEnv::Impl::go_idle(std::size_t env) {
  active[env] = 0;
  agents[env].source.reset();
  for (SensorRows* sensor : {&depth, &spectrogram, &pointgoal}) sensor->clear(env);
  for (std::vector<float>* sound : {&audiogoal, &heard}) std::ranges::fill(sound_row(*sound, env), 0.f);
}

void BatchedEnv::Impl::observe_start(std::size_t env, HearingEngines* own) {
  if (!active[env]) return;
  trace(env);
  synthesize(env, own);
  if (own && !agents[env].hearing.fill_window(*own, block_samples, sound_row(audiogoal, env), sound_row(heard, env)))
    report_nonfinite(env, "sound");
  render(env);
  observe(env, own);
}

void BatchedEnv::Impl::restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own) {
  Agent& agent = agents[env];
  rewards[env] = 0.f;
  terminated[env] = truncated[env] = collided[env] = 0;
  agent.episode_count = cursor.episode_count;
  if (!cursor.active) return go_idle(env);
  const auto damaged = [](const char* what) { throw InputError("environment state", what, "resume from another checkpoint"); };
  if (!begin_episode(env, cursor.episode_index, cursor.episode_count)) damaged("its episode has no path to its goal in this scene");
  // What is heard now depends on the poses of the last second only: poses before are walked, not rendered.
  const std::size_t window_blocks = (size_of(config.observation.sound.num_samples) + size_of(block_samples) - 1) / size_of(block_samples);
  const std::size_t silent = cursor.actions.size() > window_blocks ? cursor.actions.size() - window_blocks : 0;
  for (std::size_t step = 0; step <= cursor.actions.size(); ++step) {
    if (step > 0) {
      if (agent.state.terminated() || agent.state.truncated()) damaged("its actions go on after the end of the episode");
      move(env, static_cast<Action>(cursor.actions[step - 1]));
    }
    if (step < silent) continue;
    trace(env);
    synthesize(env, own);
    if (step == 0) {
      if (own) agent.hearing.fill_window(*own, block_samples, sound_row(audiogoal, env), sound_row(heard, env));
    } else if (step == silent) {
      agent.hearing.seek(size_of(config.observation.sound.num_samples) + step * size_of(block_samples));
    } else {
      convolve(env, own);
    }
  }
  if (ended(env)) damaged("its last action ends the episode");
  rewards[env] = 0.f;
  render(env);
  observe(env, own);
}

}  // namespace earshot
