#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "envs/batched_env_impl.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// How many other episodes an env tries when one cannot begin.
constexpr std::uint32_t kMaxDraws = 64;

}  // namespace

void BatchedEnv::Impl::restart(std::size_t env, HearingEngines* own) {
  if (!ended(env)) return;
  for (SensorRows* sensor : {&depth, &spectrogram, &pointgoal}) sensor->keep(env);
  begin_next_episode(env, own);
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

void BatchedEnv::Impl::begin_next_episode(std::size_t env, HearingEngines* own) {
  Agent& agent = agents[env];
  const bool once = config.order == EpisodeOrder::once;
  int count = agent.episode_count + 1;
  // Order `once` needs no bound: its episodes come to an end.
  for (std::uint32_t attempt = 0; once || attempt < kMaxDraws; ++attempt) {
    const auto index = draw_episode(env, count, once ? 0 : attempt);
    if (!index) return go_idle(env);
    begin_episode(env, *index, count, own);
    if (!agent.fault) {
      if (const auto next = draw_episode(env, count + 1, 0); next && config.prefetch) {
        const Episode& episode = set->episodes[*next];
        scenes->prefetch(episode.scene_id, episode.goal_position, config.task.source_height_m);
      }
      return;
    }
    quarantine_episode(env);
    ++failed;
    if (once) {
      agent.failed_starts.push_back(failed_episode(env));
      ++count;
    }
  }
  const Episode& last = episode_of(agent);
  const FaultReport fault = *agent.fault;
  go_idle(env);
  throw InputError("episode set",
                   fmt::format("{} episodes in a row could not begin, the last one for its {}: episode '{}' in {}: {}", kMaxDraws,
                               name_of(fault.fault), last.episode_id, last.scene_id, fault.detail),
                   "bring back what is missing, or make the set again for these scenes and this agent size");
}

/// The agent as it is before its episode begins.
void BatchedEnv::Impl::prepare_episode(std::size_t env, std::uint64_t episode_index, int episode_count) {
  Agent& agent = agents[env];
  agent.fault.reset();
  agent.episode_index = episode_index;
  agent.episode_count = episode_count;
  agent.state = {};
  agent.actions.clear();
  agent.actions.reserve(size_of(config.task.max_steps));
  agent.depth_is_current = false;
  active[env] = 1;
}

void BatchedEnv::Impl::begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count, HearingEngines* own) {
  Agent& agent = agents[env];
  prepare_episode(env, episode_index, episode_count);
  try {
    enter_episode(env);
    if (!agent.fault) observe_start(env, own);
  } catch (const InputError& error) {
    report(env, Fault::scene, error.what());
  } catch (const RunError& error) {
    report(env, Fault::scene, error.what());
  }
  if (!agent.fault) ++begun;
}

/// Scene, source, start and sound of the episode that the agent's index names.
void BatchedEnv::Impl::enter_episode(std::size_t env) {
  Agent& agent = agents[env];
  const Episode& episode = episode_of(agent);
  const TaskConfig& task = config.task;
  agent.source = scenes->source(episode.scene_id, episode.goal_position, task.source_height_m);
  const Navmesh& navmesh = agent.source->scene->navmesh;
  const GeodesicField& field = agent.source->field;
  const auto start = navmesh.snap(agent.source->scene->scene->to_local(episode.start_position));
  const auto distance_m = start ? field.distance_m(*start) : std::nullopt;
  if (!distance_m || !std::isfinite(*distance_m))
    return report(env, Fault::path, start ? "no walkable path leads from its start to its goal" : "its start is off the walkable surface");
  const double heading_rad = heading_of(episode.start_rotation);
  // Counted here and not read from the file: published sets count 1 m steps and 90 degree turns (docs/conventions.md, section 7).
  const int oracle_actions = oracle.of(agent.episode_index, [&] {
    return std::max(1, count_oracle_actions(task, navmesh, field, *start, heading_rad).value_or(episode.num_action));
  });
  agent.state.begin(task, field, *start, heading_rad, oracle_actions);
  if (config.observation.spectrogram) {
    const LibrarySound& sound = sounds.sound(episode.sound);
    const RandomStream random(config.seed, Purpose::sound, global_id(env), static_cast<std::uint32_t>(agent.episode_count));
    agent.hearing.begin(*agent.source, sound, random.below(static_cast<std::uint32_t>(sound.clip.samples.size()), 0));
  }
}

void BatchedEnv::Impl::go_idle(std::size_t env) {
  active[env] = 0;
  agents[env].source.reset();
  agents[env].fault.reset();
  clear_rows(env);
}

void BatchedEnv::Impl::observe_start(std::size_t env, HearingEngines* own) {
  trace(env);
  synthesize(env, own);
  if (own && runs(env)) {
    if (!agents[env].hearing.fill_window(*own, block_samples, sound_row(audiogoal, env), sound_row(heard, env)))
      report(env, Fault::sound, "the sound before the first step is not finite");
    else if (hook)
      check(env, Fault::sound, sound_row(audiogoal, env));
  }
  render(env);
  observe(env, own);
}

void BatchedEnv::Impl::restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own) {
  Agent& agent = agents[env];
  rewards[env] = 0.f;
  terminated[env] = truncated[env] = collided[env] = quarantined[env] = 0;
  agent.episode_count = cursor.episode_count;
  agent.failed_starts.clear();
  if (!cursor.active) return go_idle(env);
  const auto damaged = [](const char* what) { throw InputError("environment state", what, "resume from another checkpoint"); };
  const auto stop_at_fault = [&] {
    if (agent.fault)
      throw InputError("episode '" + episode_of(agent).episode_id + "' in " + episode_of(agent).scene_id, agent.fault->detail,
                       "it ran when the state was saved: bring back what is missing, or resume from another checkpoint");
  };
  prepare_episode(env, cursor.episode_index, cursor.episode_count);
  enter_episode(env);
  stop_at_fault();
  ++begun;
  // What is heard now depends on the poses of the last second only, and on the step before, on whose way paths arrive: poses before are
  // walked, not rendered.
  const std::size_t window_blocks =
      (size_of(config.observation.sound.num_samples) + size_of(block_samples) - 1) / size_of(block_samples) + 1;
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
      if (own && runs(env)) agent.hearing.fill_window(*own, block_samples, sound_row(audiogoal, env), sound_row(heard, env));
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
  stop_at_fault();
}

}  // namespace earshot
