#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "envs/batch/batched_env_impl.h"
#include "envs/task/goal_silence.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// How many other episodes an env tries when one cannot begin.
constexpr std::uint32_t kMaxDraws = 64;

/// A sound that begins and ends at these samples of the stream, from its beginning.
PlayedSound played_from(const LibrarySound& sound, std::uint64_t begin, std::uint64_t end, float level_db) {
  const std::uint64_t length = sound.clip.samples.size();
  return {.sound = &sound,
          .position = {.clip_offset = (length - begin % length) % length, .already_playing = false, .begin = begin, .end = end},
          .gain = std::pow(10.f, level_db / 20.f)};
}

float rms_at_1_m(const LibrarySound& sound, float gain) {
  double sum = 0;
  for (const float sample : sound.clip.samples) sum += static_cast<double>(sample) * static_cast<double>(sample);
  return gain * static_cast<float>(std::sqrt(sum / static_cast<double>(sound.clip.samples.size())) / (4.0 * std::numbers::pi));
}

}  // namespace

std::optional<std::uint64_t> BatchedEnv::Impl::draw_episode(std::size_t env, int episode_count, std::uint32_t attempt) const {
  const std::uint64_t num_episodes = set->episodes.size();
  const auto count = static_cast<std::uint32_t>(episode_count);
  if (config.order == EpisodeOrder::random)
    return RandomStream(agents[first_row(env)].seed, Purpose::episode_order, agents[first_row(env)].stream, count, attempt)
        .below(static_cast<std::uint32_t>(num_episodes), 0);
  const std::uint64_t index = global_id(env) + std::uint64_t{count} * static_cast<std::uint64_t>(total_envs);
  return index < num_episodes ? std::optional(index) : std::nullopt;
}

void BatchedEnv::Impl::begin_next_episode(std::size_t env, HearingEngines* own) {
  const bool once = config.order == EpisodeOrder::once;
  int count = agents[first_row(env)].episode_count + 1;
  // Order `once` needs no bound: its episodes come to an end.
  for (std::uint32_t attempt = 0; once || attempt < kMaxDraws; ++attempt) {
    const auto index = draw_episode(env, count, once ? 0 : attempt);
    if (!index) return go_idle(env);
    begin_episode(env, *index, count, own);
    if (!goes_on(env)) return;
    const FaultReport* fault = fault_of(env);
    if (!fault) {
      if (const auto next = draw_episode(env, count + 1, 0); next && config.prefetch) {
        const Episode& episode = set->episodes[*next];
        scenes->prefetch(episode.scene_id, episode.goal_position, config.task.source_height_m);
        for (const EpisodeSource& source : episode.sources)
          if (source.path.empty() && source.position != episode.goal_position)
            scenes->prefetch(episode.scene_id, source.position, config.task.source_height_m);
      }
      return;
    }
    quarantine_episode(env, *fault);
    ++failed;
    if (once) {
      for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row)
        envs[env].failed_starts.push_back(failed_episode(row, *fault));
      ++count;
    }
  }
  const Episode& last = episode_of(agents[first_row(env)]);
  const FaultReport fault = *fault_of(env);
  go_idle(env);
  throw InputError("episode set",
                   fmt::format("{} episodes in a row could not begin, the last one for its {}: episode '{}' in {}: {}", kMaxDraws,
                               name_of(fault.fault), last.episode_id, last.scene_id, fault.detail),
                   "bring back what is missing, or make the set again for these scenes and this agent size");
}

/// The agents as they are before their episode begins.
void BatchedEnv::Impl::prepare_episode(std::size_t env, std::uint64_t episode_index, int episode_count) {
  EnvRun& run = envs[env];
  run.has_episode = true;
  run.has_ended = false;
  run.is_void = false;
  run.steps = 0;
  for (Agent& agent : agents_of(env)) {
    agent.fault.reset();
    agent.episode_index = episode_index;
    agent.episode_count = episode_count;
    agent.state = {};
    agent.waits = false;
    agent.actions.clear();
    agent.actions.reserve(size_of(config.task.max_steps));
    agent.pictures_are_current = false;
    agent.pictures_now = {};
    agent.path.clear();
    if (rows.of(SensorKind::topdown_map)) agent.path.reserve(size_of(config.task.max_steps) + 1);
  }
}

void BatchedEnv::Impl::begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count, HearingEngines* own) {
  const std::size_t first = first_row(env);
  prepare_episode(env, episode_index, episode_count);
  // What an env that is given up did, and in which episode, is read while its stage still runs: it is known from here on.
  if (!goes_on(env)) return;
  guarded(first, Fault::scene, [&] {
    enter_episode(env);
    if (fault_of(env) || !goes_on(env)) return;
    move_sounds(env, own);
    for_agents(env, own, [&](std::size_t row, HearingEngines* engine) {
      guarded(row, Fault::scene, [&] { observe_start(row, engine); });
      return true;
    });
  });
  if (!fault_of(env)) ++begun;
}

/// Lets go of the scene and all that belongs to it.
void BatchedEnv::Impl::leave_episode(std::size_t env) {
  envs[env].sounds.clear();
  envs[env].playing.clear();
  envs[env].other_goals.clear();
  for (Agent& agent : agents_of(env)) {
    agent.source.reset();
    agent.appearance.reset();
  }
}

/// Scene, source, starts and sounds of the episode that the agents' index names.
void BatchedEnv::Impl::enter_episode(std::size_t env) {
  const Episode& episode = episode_of(agents[first_row(env)]);
  leave_episode(env);  // first, so that the cache may drop the last episode's scene for this one's
  const auto source = scenes->source(episode.scene_id, episode.goal_position, config.task.source_height_m);
  const EnvScene& scene = *source->scene;
  const bool looks = std::any_of(cameras.begin(), cameras.end(), [](const AgentCamera& camera) { return camera.rgb || camera.semantic; });
  const auto appearance = looks ? scene.looks->of(*scene.scene) : nullptr;
  for (const glm::dvec3 other : episode.other_goals) envs[env].other_goals.emplace_back(scene.navmesh, scene.scene->to_local(other));
  std::function<double(const std::string&)> clip_length_s;
  if (config.observation.hears())
    clip_length_s = [&](const std::string& name) {
      const SoundClip& clip = sounds.sound(name).clip;
      return static_cast<double>(clip.samples.size()) / static_cast<double>(clip.sample_rate_hz);
    };
  const double silent_from_s = goal_silent_from_s(episode, clip_length_s);
  for (Agent& agent : agents_of(env)) {
    agent.source = source;
    agent.appearance = appearance;
  }
  for (std::size_t row = first_row(env); row < first_row(env) + per_env && !fault_of(env); ++row) enter_agent(row, silent_from_s);
  if (!fault_of(env) && config.observation.hears()) begin_hearing(env);
}

/// Puts an agent where it starts.
void BatchedEnv::Impl::enter_agent(std::size_t row, double silent_from_s) {
  Agent& agent = agents[row];
  const TaskConfig& task = config.task;
  const Episode& episode = episode_of(agent);
  const EnvScene& scene = *agent.source->scene;
  const NearestGoal goal = goal_of(row);
  const int number = agent_of(row);
  const EpisodeAgent* further = number > 0 ? &episode.other_agents[size_of(number - 1)] : nullptr;
  const auto start = scene.navmesh.snap(scene.scene->to_local(further ? further->start_position : episode.start_position));
  const auto distance_m = start ? goal.distance_m(*start) : std::nullopt;
  if (!distance_m || !std::isfinite(*distance_m)) {
    std::string detail = start ? "no walkable path leads from its start to its goal" : "its start is off the walkable surface";
    if (further) detail += fmt::format(" (agent {})", number);
    return report(row, Fault::path, std::move(detail));
  }
  const double heading_rad = heading_of(further ? further->start_rotation : episode.start_rotation);
  // Counted here and not read from the file: published sets count 1 m steps and 90 degree turns (docs/conventions.md, section 7).
  const int known = further ? task.max_steps : episode.num_action;
  const int oracle_actions = oracle.of(agent.episode_index * per_env + size_of(number), [&] {
    return std::max(1, count_oracle_actions(task, scene.navmesh, goal, *start, heading_rad).value_or(known));
  });
  agent.state.begin(task, goal, *start, heading_rad, oracle_actions, silent_from_s);
  agent.start_pose = agent.state.pose(task);
  if (!rows.of(SensorKind::topdown_map)) return;
  agent.path.push_back(*start);
  agent.goals.assign(1, scene.scene->to_local(episode.goal_position));
  for (const glm::dvec3 other : episode.other_goals) agent.goals.push_back(scene.scene->to_local(other));
}

NearestGoal BatchedEnv::Impl::goal_of(std::size_t row) const {
  NearestGoal goal(agents[row].source->field);
  for (const GeodesicField& other : envs[env_of(row)].other_goals) goal.add(other);
  return goal;
}

/// What the sources and the agents of an env play, and noise.
void BatchedEnv::Impl::begin_hearing(std::size_t env) {
  EnvRun& run = envs[env];
  const Agent& lead = agents[first_row(env)];
  const Episode& episode = episode_of(lead);
  const auto& scene = lead.source->scene;
  const auto count = static_cast<std::uint32_t>(lead.episode_count);
  const RandomStream random(lead.seed, Purpose::sound, lead.stream, count);
  const double rate_hz = static_cast<double>(config.acoustics.sample_rate_hz);
  float noise_reference = 0;  // root mean square of the goal's sound at 1 m
  if (episode.sources.empty()) {
    const LibrarySound& sound = sounds.sound(episode.sound);
    run.sounds.push_back({.played = {.source = lead.source.get(),
                                     .sound = &sound,
                                     .position = {.clip_offset = random.below(static_cast<std::uint32_t>(sound.clip.samples.size()), 0)}},
                          .moving = nullptr});
    if (episode.noise_snr_db) noise_reference = rms_at_1_m(sound, 1);
  }
  for (const EpisodeSource& source : episode.sources) {
    const LibrarySound& sound = sounds.sound(source.sound);
    // The first window is the second before the episode.
    const auto begin = static_cast<std::uint64_t>(config.observation.sound.num_samples + std::llround(source.onset_s * rate_hz));
    std::uint64_t end = ~std::uint64_t{0};
    if (source.duration_s >= 0) end = begin + static_cast<std::uint64_t>(std::llround(source.duration_s * rate_hz));
    if (!source.loop) end = std::min(end, begin + sound.clip.samples.size());
    EnvSound heard_one{.played = played_from(sound, begin, end, source.level_db), .moving = nullptr};
    if (source.path.empty()) {
      run.playing.push_back(scenes->source(episode.scene_id, source.position, config.task.source_height_m));
      heard_one.played.source = run.playing.back().get();
    } else {
      std::vector<TimedPlace> path;
      for (const Waypoint& at : source.path)
        path.push_back({.sample = config.observation.sound.num_samples + at.t_s * rate_hz, .position = source_at(*scene, at.position)});
      heard_one.moving = std::make_unique<MovingSource>(scene, source_at(*scene, source.position), std::move(path));
    }
    if (episode.noise_snr_db && (source.goal || noise_reference == 0)) noise_reference = rms_at_1_m(sound, heard_one.played.gain);
    run.sounds.push_back(std::move(heard_one));
  }
  begin_agent_sounds(env);
  for (EnvSound& sound : run.sounds) {
    sound.played.moving = sound.moving.get();
    sound.played.restarts = config.sound_restarts;
  }

  BackgroundNoise noise{.seed = lead.seed, .stream = lead.stream, .episode = count};
  if (episode.noise_snr_db) noise.rms = noise_reference * std::pow(10.f, -*episode.noise_snr_db / 20.f);
  for (std::size_t row = first_row(env); row < first_row(env) + per_env; ++row) {
    run.played.clear();
    for (const EnvSound& sound : run.sounds)
      if (sound.agent != agent_of(row)) run.played.push_back(sound.played);
    noise.agent = static_cast<std::uint32_t>(agent_of(row));
    agents[row].hearing.begin(run.played, noise);
  }
}

/// Agents sound from the start of the episode on, from the height of sources above where they are.
void BatchedEnv::Impl::begin_agent_sounds(std::size_t env) {
  const Agent& lead = agents[first_row(env)];
  const Episode& episode = episode_of(lead);
  for (int number = 0; per_env > 1 && number < static_cast<int>(per_env); ++number) {
    const EpisodeAgent* further = number > 0 ? &episode.other_agents[size_of(number - 1)] : nullptr;
    const std::string& name = further ? further->sound : episode.agent_sound;
    if (name.empty()) continue;
    const glm::vec3 home = agents[first_row(env) + size_of(number)].start_pose.position + glm::vec3(0, config.task.source_height_m, 0);
    envs[env].sounds.push_back({.played = played_from(sounds.sound(name), size_of(config.observation.sound.num_samples), ~std::uint64_t{0},
                                                      further ? further->level_db : episode.agent_level_db),
                                .moving = std::make_unique<MovingSource>(lead.source->scene, home),
                                .agent = number});
  }
}

glm::vec3 BatchedEnv::Impl::source_at(const EnvScene& scene, glm::dvec3 foot) const {
  return scene.scene->to_local(foot) + glm::vec3(0, config.task.source_height_m, 0);
}

void BatchedEnv::Impl::go_idle(std::size_t env) {
  envs[env].has_episode = false;
  leave_episode(env);
  for (Agent& agent : agents_of(env)) {
    agent.pictures_now = {};
    agent.fault.reset();
  }
  clear_rows(env);
}

void BatchedEnv::Impl::observe_start(std::size_t row, HearingEngines* own) {
  trace(row, own, config.observation.sound.num_samples);  // the window before the first step is heard with it
  synthesize(row, own);
  if (own && runs(row)) {
    if (!agents[row].hearing.fill_window(*own, block_samples, rows.of(SensorKind::waveform)->row<float>(row),
                                         rows.of(SensorKind::heard)->row<float>(row)))
      report(row, Fault::sound, "the sound before the first step is not finite");
    else if (hook)
      check(row, Fault::sound, rows.of(SensorKind::waveform)->row<float>(row));
  }
  render(row);
  observe(row, own);
}

}  // namespace earshot
