#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "envs/batched_env_impl.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

/// How many other episodes an env tries when one cannot begin.
constexpr std::uint32_t kMaxDraws = 64;

/// Seconds from the start of the episode to the end of a source's sound.  sound: null where no agent hears; clips that are played once then
/// count as endless.
double end_of(const EpisodeSource& source, const LibrarySound* sound) {
  double length_s = source.duration_s < 0 ? std::numeric_limits<double>::infinity() : source.duration_s;
  if (!source.loop && sound)
    length_s = std::min(length_s, static_cast<double>(sound->clip.samples.size()) / static_cast<double>(sound->clip.sample_rate_hz));
  return source.onset_s + length_s;
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
    return RandomStream(agents[env].seed, Purpose::episode_order, agents[env].stream, count, attempt)
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
    if (!goes_on(env)) return;
    if (!agent.fault) {
      if (const auto next = draw_episode(env, count + 1, 0); next && config.prefetch) {
        const Episode& episode = set->episodes[*next];
        scenes->prefetch(episode.scene_id, episode.goal_position, config.task.source_height_m);
        for (const EpisodeSource& source : episode.sources)
          if (source.position != episode.goal_position) scenes->prefetch(episode.scene_id, source.position, config.task.source_height_m);
      }
      return;
    }
    quarantine_episode(env, *agent.fault);
    ++failed;
    if (once) {
      agent.failed_starts.push_back(failed_episode(env, *agent.fault));
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
  agent.has_ended = false;
  agent.pictures_are_current = false;
  agent.pictures_now = {};
  agent.path.clear();
  if (topdown_map) agent.path.reserve(size_of(config.task.max_steps) + 1);
  active[env] = 1;
}

void BatchedEnv::Impl::begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count, HearingEngines* own) {
  Agent& agent = agents[env];
  prepare_episode(env, episode_index, episode_count);
  guarded(env, Fault::scene, [&] {
    enter_episode(env);
    if (!agent.fault && goes_on(env)) observe_start(env, own);
  });
  if (!agent.fault) ++begun;
}

/// Scene, source, start and sound of the episode that the agent's index names.
void BatchedEnv::Impl::enter_episode(std::size_t env) {
  Agent& agent = agents[env];
  const Episode& episode = episode_of(agent);
  const TaskConfig& task = config.task;
  // First, so that the cache may drop the last episode's scene for this one's.
  agent.source.reset();
  agent.playing.clear();
  agent.other_goals.clear();
  agent.appearance.reset();
  agent.source = scenes->source(episode.scene_id, episode.goal_position, task.source_height_m);
  const EnvScene& scene = *agent.source->scene;
  const bool looks = std::any_of(cameras.begin(), cameras.end(), [](const AgentCamera& camera) { return camera.rgb || camera.semantic; });
  if (looks) agent.appearance = scene.looks->of(*scene.scene);
  const Navmesh& navmesh = scene.navmesh;
  for (const glm::dvec3 other : episode.other_goals) agent.other_goals.emplace_back(navmesh, scene.scene->to_local(other));
  const NearestGoal goal = goal_of(agent);
  const auto start = navmesh.snap(scene.scene->to_local(episode.start_position));
  const auto distance_m = start ? goal.distance_m(*start) : std::nullopt;
  if (!distance_m || !std::isfinite(*distance_m))
    return report(env, Fault::path, start ? "no walkable path leads from its start to its goal" : "its start is off the walkable surface");
  const double heading_rad = heading_of(episode.start_rotation);
  // Counted here and not read from the file: published sets count 1 m steps and 90 degree turns (docs/conventions.md, section 7).
  const int oracle_actions = oracle.of(agent.episode_index, [&] {
    return std::max(1, count_oracle_actions(task, navmesh, goal, *start, heading_rad).value_or(episode.num_action));
  });
  const bool names_a_goal = std::any_of(episode.sources.begin(), episode.sources.end(), [](const auto& source) { return source.goal; });
  double silent_from_s = names_a_goal ? 0 : std::numeric_limits<double>::infinity();
  for (const EpisodeSource& source : episode.sources)  // the goal is silent when the last of its sounds is
    if (source.goal)
      silent_from_s = std::max(silent_from_s, end_of(source, config.observation.hears() ? &sounds.sound(source.sound) : nullptr));
  agent.state.begin(task, goal, *start, heading_rad, oracle_actions, silent_from_s);
  agent.start_pose = agent.state.pose(task);
  if (topdown_map) {
    agent.path.push_back(*start);
    agent.goals.assign(1, scene.scene->to_local(episode.goal_position));
    for (const glm::dvec3 other : episode.other_goals) agent.goals.push_back(scene.scene->to_local(other));
  }
  if (config.observation.hears()) begin_hearing(env);
}

NearestGoal BatchedEnv::Impl::goal_of(const Agent& agent) const {
  NearestGoal goal(agent.source->field);
  for (const GeodesicField& other : agent.other_goals) goal.add(other);
  return goal;
}

/// What the agent's sources play, and noise.
void BatchedEnv::Impl::begin_hearing(std::size_t env) {
  Agent& agent = agents[env];
  const Episode& episode = episode_of(agent);
  const auto count = static_cast<std::uint32_t>(agent.episode_count);
  const RandomStream random(agent.seed, Purpose::sound, agent.stream, count);
  const double rate_hz = static_cast<double>(config.acoustics.sample_rate_hz);
  std::vector<PlayedSound>& played = agent.played;
  played.clear();
  float noise_reference = 0;  // root mean square of the goal's sound at 1 m
  if (episode.sources.empty()) {
    const LibrarySound& sound = sounds.sound(episode.sound);
    played.push_back({.source = agent.source.get(),
                      .sound = &sound,
                      .position = {.clip_offset = random.below(static_cast<std::uint32_t>(sound.clip.samples.size()), 0)}});
    if (episode.noise_snr_db) noise_reference = rms_at_1_m(sound, 1);
  }
  for (const EpisodeSource& source : episode.sources) {
    agent.playing.push_back(scenes->source(episode.scene_id, source.position, config.task.source_height_m));
    const LibrarySound& sound = sounds.sound(source.sound);
    const std::uint64_t length = sound.clip.samples.size();
    // The first window is the second before the episode.
    const auto begin = static_cast<std::uint64_t>(config.observation.sound.num_samples + std::llround(source.onset_s * rate_hz));
    std::uint64_t end = ~std::uint64_t{0};
    if (source.duration_s >= 0) end = begin + static_cast<std::uint64_t>(std::llround(source.duration_s * rate_hz));
    if (!source.loop) end = std::min(end, begin + length);
    const float gain = std::pow(10.f, source.level_db / 20.f);
    played.push_back({.source = agent.playing.back().get(),
                      .sound = &sound,
                      .position = {.clip_offset = (length - begin % length) % length,  // from its beginning
                                   .already_playing = false,
                                   .begin = begin,
                                   .end = end},
                      .gain = gain});
    for (const Waypoint& at : source.path)
      played.back().path.push_back(
          {.sample = config.observation.sound.num_samples + at.t_s * rate_hz,
           .position = agent.source->scene->scene->to_local(at.position) + glm::vec3(0, config.task.source_height_m, 0)});
    if (episode.noise_snr_db && (source.goal || noise_reference == 0)) noise_reference = rms_at_1_m(sound, gain);
  }
  BackgroundNoise noise{.seed = agent.seed, .stream = agent.stream, .episode = count};
  if (episode.noise_snr_db) noise.rms = noise_reference * std::pow(10.f, -*episode.noise_snr_db / 20.f);
  agent.hearing.begin(played, noise);
}

void BatchedEnv::Impl::go_idle(std::size_t env) {
  active[env] = 0;
  agents[env].pictures_now = {};
  agents[env].source.reset();
  agents[env].playing.clear();
  agents[env].other_goals.clear();
  agents[env].fault.reset();
  clear_rows(env);
}

void BatchedEnv::Impl::observe_start(std::size_t env, HearingEngines* own) {
  trace(env, own, config.observation.sound.num_samples);  // the window before the first step is heard with it
  synthesize(env, own);
  if (own && runs(env)) {
    if (!agents[env].hearing.fill_window(*own, block_samples, waveform->row<float>(env), heard->row<float>(env)))
      report(env, Fault::sound, "the sound before the first step is not finite");
    else if (hook)
      check(env, Fault::sound, waveform->row<float>(env));
  }
  render(env);
  observe(env, own);
}

void BatchedEnv::Impl::restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own) {
  Agent& agent = agents[env];
  agent.seed = cursor.seed;
  agent.stream = cursor.stream;
  agent.episode_count = cursor.episode_count;
  agent.failed_starts.clear();
  if (!cursor.active) return go_idle(env);
  if (cursor.is_void) {
    if (config.autoreset == Autoreset::same_step) return begin_next_episode(env, own);
    prepare_episode(env, cursor.episode_index, cursor.episode_count);
    clear_rows(env);
    agent.has_ended = true;
    return;
  }
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
  // What is heard now depends on the poses of the last second only, and on the two steps before, by which paths arrive and which of them
  // glide (PathGlider::choose): poses before are walked, not rendered.
  const std::size_t window_blocks =
      (size_of(config.observation.sound.num_samples) + size_of(block_samples) - 1) / size_of(block_samples) + 2;
  const std::size_t silent = cursor.actions.size() > window_blocks ? cursor.actions.size() - window_blocks : 0;
  for (std::size_t step = 0; step <= cursor.actions.size(); ++step) {
    if (step > 0) {
      if (agent.state.terminated() || agent.state.truncated()) damaged("its actions go on after the end of the episode");
      move(env, static_cast<Action>(cursor.actions[step - 1]));
    }
    if (step < silent) continue;
    const std::size_t window = size_of(config.observation.sound.num_samples);
    if (step > 0 && step == silent) agent.hearing.seek(window + (step - 1) * size_of(block_samples));
    trace(env, own, step == 0 ? config.observation.sound.num_samples : block_samples);
    synthesize(env, own);
    if (step == 0) {
      if (own && runs(env)) agent.hearing.fill_window(*own, block_samples, waveform->row<float>(env), heard->row<float>(env));
    } else if (step == silent) {
      agent.hearing.seek(window + step * size_of(block_samples));
    } else {
      convolve(env, own);
    }
  }
  if (ended(env) != cursor.ended) damaged("its last action ends the episode, or should");
  rewards[env] = 0.f;
  render(env);
  observe(env, own);
  stop_at_fault();
  if (!cursor.ended) return;
  agent.has_ended = true;
  keep_rows(env);
}

EnvCursor BatchedEnv::Impl::cursor_of(std::size_t env) const {
  const Agent& agent = agents[env];
  const bool is_void = agent.stalled || (agent.has_ended && agent.fault);
  return {.active = active[env] != 0 || agent.stalled,
          .ended = agent.has_ended,
          .is_void = is_void,
          .seed = agent.seed,
          .stream = agent.stream,
          .episode_index = agent.episode_index,
          .episode_count = std::max(0, agent.episode_count),
          .actions = is_void ? std::vector<std::int8_t>{} : agent.actions};
}

}  // namespace earshot
