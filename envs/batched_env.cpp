#include "envs/batched_env.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <numbers>
#include <utility>

#include "envs/agent_hearing.h"
#include "envs/env_state.h"
#include "envs/sound_library.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/vision/ray_renderer.h"

namespace earshot {
namespace {

/// How many other episodes an env tries when one has no path to its goal.
constexpr std::uint32_t kMaxDraws = 64;

enum Stage : std::size_t { move_stage, trace_stage, synthesize_stage, convolve_stage, render_stage, observe_stage, reset_stage, num_stages };

/// Everything that belongs to one agent and is not an observation.
struct Agent {
  bool depth_is_current = false;
  std::uint64_t episode_index = 0;
  int episode_count = -1;  // none begun
  std::shared_ptr<const EnvSource> source;
  AvNavState state;
  AgentHearing hearing;
  Pose rendered_pose;
  std::vector<std::int8_t> actions;  // since the start of the episode
  std::array<double, num_stages> seconds{};
};

bool same_pose(const Pose& a, const Pose& b) { return a.position == b.position && a.heading_rad == b.heading_rad; }

std::size_t size_of(int count) { return static_cast<std::size_t>(count); }

/// One sensor of all envs, and its last values of episodes that ended in the last step.
struct SensorRows {
  void resize(int envs, int size) {
    row_size = size_of(size);
    now.assign(size_of(envs) * row_size, 0.f);
    last.assign(now.size(), 0.f);
  }
  std::span<float> row(std::size_t env) { return std::span(now).subspan(env * row_size, row_size); }
  void keep(std::size_t env) { std::copy_n(row(env).begin(), row_size, last.begin() + static_cast<std::ptrdiff_t>(env * row_size)); }
  void clear(std::size_t env) { std::fill_n(row(env).begin(), row_size, 0.f); }
  std::size_t row_size = 0;
  std::vector<float> now, last;
};

StreamConfig stream_config(const EnvConfig& config, int block_samples, int head_samples) {
  const float rate_hz = config.acoustics.sample_rate_hz;
  return {.sample_rate_hz = rate_hz,
          .max_rir_samples = static_cast<int>(std::ceil(config.acoustics.rir_length_s * rate_hz)) + head_samples,
          .max_block_samples = block_samples,
          .crossfade_samples = std::min(block_samples, static_cast<int>(std::lround(config.crossfade_s * rate_hz)))};
}

}  // namespace

struct BatchedEnv::Impl {
  EnvConfig config;
  std::shared_ptr<const EpisodeSet> set;
  std::shared_ptr<SceneCache> scenes;
  int first_env, total_envs;
  int block_samples;
  SoundLibrary sounds;
  RayRenderer renderer;
  std::vector<Agent> agents;
  std::vector<HearingEngines> engines;     // one per thread
  std::optional<tbb::task_arena> arena;    // none: the caller's thread does all
  bool started = false;

  SensorRows depth, spectrogram, pointgoal;
  std::vector<float> audiogoal, heard, rewards;
  std::vector<std::uint8_t> terminated, truncated, active, collided;
  std::vector<FinishedEpisode> finished;
  StageSeconds stage_seconds;
  std::atomic<std::uint64_t> nonfinite_events{0}, skipped_episodes{0};

  Impl(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache, int num_envs, int first,
       int total);

  int num_envs() const { return static_cast<int>(agents.size()); }
  std::uint32_t global_id(std::size_t env) const { return static_cast<std::uint32_t>(first_env) + static_cast<std::uint32_t>(env); }
  bool ended(std::size_t env) const { return terminated[env] || truncated[env]; }
  const Episode& episode_of(const Agent& agent) const { return set->episodes[agent.episode_index]; }
  std::span<float> sound_row(std::vector<float>& rows, std::size_t env) const {
    const std::size_t size = rows.size() / agents.size();
    return std::span(rows).subspan(env * size, size);
  }

  /// Runs body(env, engines of this thread) for every env, and books its time to `stage`.
  template <class Body>
  void for_each_env(Stage stage, const Body& body);

  // The stages of a step; each reads poses and writes one row of its buffer.  own: engines of this thread, null for a deaf agent.
  void move(std::size_t env, Action action);
  void trace(std::size_t env);
  void synthesize(std::size_t env, HearingEngines* own);
  void convolve(std::size_t env, HearingEngines* own);
  void render(std::size_t env);
  void observe(std::size_t env, HearingEngines* own);
  void restart(std::size_t env, HearingEngines* own);

  std::optional<std::uint64_t> draw_episode(std::size_t env, int episode_count, std::uint32_t attempt) const;
  void begin_next_episode(std::size_t env);
  bool begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count);
  void go_idle(std::size_t env);
  void observe_start(std::size_t env, HearingEngines* own);
  void restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own);
  void report_nonfinite(std::size_t env, const char* what);
  void clear_if_nonfinite(std::size_t env, SensorRows& sensor, const char* what);
  void book_stage_seconds();
};

BatchedEnv::Impl::Impl(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache,
                       int num_envs, int first, int total)
    : config(env_config),
      set(std::move(episodes)),
      scenes(std::move(cache)),
      first_env(first),
      total_envs(total > 0 ? total : first + num_envs),
      block_samples((validate(config), static_cast<int>(std::lround(config.acoustics.sample_rate_hz * config.task.step_time_s)))),
      sounds(*set, config.sound_root, config.acoustics.sample_rate_hz, config.sound_gain),
      renderer(config.observation.camera),
      agents(size_of(num_envs)) {
  require(num_envs >= 1, "num_envs", num_envs, "must be at least 1");
  require(first_env >= 0 && first_env + num_envs <= total_envs, "first_env", first_env, "must leave room for this batch within total_envs");
  if (set->episodes.empty()) throw InputError("episode set", "holds no episodes", "make one with `earshot dataset episodes`");
  EARSHOT_EXPECT(scenes->acoustics().sample_rate_hz == config.acoustics.sample_rate_hz);

  const ObservationSpec& spec = config.observation;
  if (spec.depth) depth.resize(num_envs, spec.depth_size());
  if (spec.pointgoal) pointgoal.resize(num_envs, 2);
  const int threads = config.threads > 0 ? config.threads : tbb::info::default_concurrency();
  if (threads > 1) arena.emplace(threads);
  if (spec.spectrogram) {
    spectrogram.resize(num_envs, spec.spectrogram_size());
    audiogoal.assign(size_of(num_envs) * 2 * size_of(block_samples), 0.f);
    heard.assign(size_of(num_envs) * 2 * size_of(spec.sound.num_samples), 0.f);
    const float rate_hz = config.acoustics.sample_rate_hz;
    const auto hrtf = config.hrtf.empty() ? Hrtf::rigid_sphere(rate_hz) : Hrtf::from_sofa(config.hrtf, rate_hz);
    const BandLayout bands =
        config.acoustics.bands > 0 ? BandLayout::log_spaced(config.acoustics.bands, rate_hz) : BandLayout::octaves(rate_hz);
    const auto tables = make_synthesis_tables(config.acoustics, bands, ChannelLayout::binaural, hrtf);
    for (int thread = 0; thread < threads; ++thread)
      engines.emplace_back(tables, stream_config(config, block_samples, hrtf->fft_size()), spec.sound);
  }
  rewards.assign(agents.size(), 0.f);
  for (auto* flags : {&terminated, &truncated, &active, &collided}) flags->assign(agents.size(), 0);
  finished.reserve(agents.size());
}

template <class Body>
void BatchedEnv::Impl::for_each_env(Stage stage, const Body& body) {
  const auto run = [&](std::size_t env, std::size_t thread) {
    const auto start = std::chrono::steady_clock::now();
    body(env, engines.empty() ? nullptr : &engines[thread]);
    agents[env].seconds[stage] += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  if (!arena) {
    for (std::size_t env = 0; env < agents.size(); ++env) run(env, 0);
    return;
  }
  arena->execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, agents.size(), 1),
        [&](const tbb::blocked_range<std::size_t>& range) {
          for (std::size_t env = range.begin(); env != range.end(); ++env)
            run(env, static_cast<std::size_t>(tbb::this_task_arena::current_thread_index()));
        },
        tbb::simple_partitioner());
  });
}

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
    std::span<const float> window = sound_row(heard, env);
    if (config.observation.legacy_spectrogram) {  // the new samples, then zeros (FACTS 2.3, step 7)
      const std::size_t samples = own->window.size() / 2, block = size_of(block_samples);
      const auto sound = sound_row(audiogoal, env);
      std::fill(own->window.begin(), own->window.end(), 0.f);
      for (std::size_t ear = 0; ear < 2; ++ear)
        std::copy_n(sound.begin() + static_cast<std::ptrdiff_t>(ear * block), block,
                    own->window.begin() + static_cast<std::ptrdiff_t>(ear * samples));
      window = own->window;
    }
    own->analyzer.analyze(window, spectrogram.row(env));
    clear_if_nonfinite(env, spectrogram, "spectrogram");
  }
  if (config.observation.pointgoal) {
    const Pose pose = agents[env].state.pose(config.task);
    const glm::dvec3 toward = glm::dvec3(episode_of(agents[env]).goal_position) - glm::dvec3(pose.position);
    const double bearing_rad = std::atan2(-toward.x, -toward.z);  // forward_of(h) = (-sin h, 0, -cos h)
    pointgoal.row(env)[0] = static_cast<float>(std::hypot(toward.x, toward.z));
    pointgoal.row(env)[1] = static_cast<float>(std::remainder(bearing_rad - pose.heading_rad, 2.0 * std::numbers::pi));
    clear_if_nonfinite(env, pointgoal, "pointgoal");
  }
}

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
    return RandomStream(config.seed, Purpose::episode_order, global_id(env), count, attempt).below(static_cast<std::uint32_t>(num_episodes), 0);
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
  const auto start = navmesh.snap(episode.start_position);
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
  const SoundClip& clip = sounds.clip(episode.sound);
  const RandomStream random(config.seed, Purpose::sound, global_id(env), static_cast<std::uint32_t>(episode_count));
  agent.hearing.begin(*agent.source, clip, random.below(static_cast<std::uint32_t>(clip.samples.size()), 0));
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

void BatchedEnv::Impl::report_nonfinite(std::size_t env, const char* what) {
  if (nonfinite_events.fetch_add(1) > 0) return;
  const Agent& agent = agents[env];
  const Pose pose = agent.state.pose(config.task);
  spdlog::error("{} is not finite and was set to zero (further cases are counted only): scene {}, episode '{}', step {}, position {} {} {}, heading {} rad, "
                "env {}, seed {}",
                what, episode_of(agent).scene_id, episode_of(agent).episode_id, agent.state.steps(), pose.position.x, pose.position.y,
                pose.position.z, pose.heading_rad, global_id(env), config.seed);
}

void BatchedEnv::Impl::clear_if_nonfinite(std::size_t env, SensorRows& sensor, const char* what) {
  if (all_finite(sensor.row(env))) return;
  sensor.clear(env);
  report_nonfinite(env, what);
}

void BatchedEnv::Impl::book_stage_seconds() {
  std::array<double, num_stages> sum{};
  for (const Agent& agent : agents)
    for (std::size_t stage = 0; stage < num_stages; ++stage) sum[stage] += agent.seconds[stage];
  stage_seconds = {.move = sum[move_stage],
                   .trace = sum[trace_stage],
                   .synthesize = sum[synthesize_stage],
                   .convolve = sum[convolve_stage],
                   .render = sum[render_stage],
                   .observe = sum[observe_stage],
                   .reset = sum[reset_stage]};
}

BatchedEnv::BatchedEnv(const EnvConfig& config, std::shared_ptr<const EpisodeSet> set, std::shared_ptr<SceneCache> scenes, int num_envs,
                       int first_env, int total_envs)
    : impl_(std::make_unique<Impl>(config, std::move(set), std::move(scenes), num_envs, first_env, total_envs)) {}

BatchedEnv::~BatchedEnv() = default;

void BatchedEnv::reset() {
  Impl& in = *impl_;
  in.finished.clear();
  for (auto* flags : {&in.terminated, &in.truncated, &in.collided}) std::ranges::fill(*flags, std::uint8_t{0});
  std::ranges::fill(in.rewards, 0.f);
  for (Agent& agent : in.agents) agent.episode_count = -1;
  in.for_each_env(reset_stage, [&](std::size_t env, HearingEngines* own) {
    in.begin_next_episode(env);
    in.observe_start(env, own);
  });
  in.started = true;
  in.book_stage_seconds();
}

void BatchedEnv::step(std::span<const std::int32_t> actions) {
  Impl& in = *impl_;
  EARSHOT_EXPECT(in.started && actions.size() == in.agents.size());
  in.finished.clear();
  in.for_each_env(move_stage, [&](std::size_t env, HearingEngines*) { in.move(env, static_cast<Action>(actions[env])); });
  in.for_each_env(trace_stage, [&](std::size_t env, HearingEngines*) { in.trace(env); });
  in.for_each_env(synthesize_stage, [&](std::size_t env, HearingEngines* own) { in.synthesize(env, own); });
  in.for_each_env(convolve_stage, [&](std::size_t env, HearingEngines* own) { in.convolve(env, own); });
  in.for_each_env(render_stage, [&](std::size_t env, HearingEngines*) { in.render(env); });
  in.for_each_env(observe_stage, [&](std::size_t env, HearingEngines* own) { in.observe(env, own); });
  for (std::size_t env = 0; env < in.agents.size(); ++env)
    if (in.ended(env))
      in.finished.push_back({.env = static_cast<int>(in.global_id(env)),
                             .episode_index = in.agents[env].episode_index,
                             .metrics = in.agents[env].state.metrics(in.config.task),
                             .actions = std::move(in.agents[env].actions)});
  if (!in.finished.empty()) in.for_each_env(reset_stage, [&](std::size_t env, HearingEngines* own) { in.restart(env, own); });
  in.book_stage_seconds();
}

std::string BatchedEnv::save_state() const {
  const Impl& in = *impl_;
  EnvState state{.set_hash = in.set->hash,
                 .seed = in.config.seed,
                 .first_env = in.first_env,
                 .total_envs = in.total_envs,
                 .started = in.started,
                 .envs = {}};
  for (std::size_t env = 0; env < in.agents.size(); ++env) {
    const Agent& agent = in.agents[env];
    state.envs.push_back({.active = in.active[env] != 0,
                          .episode_index = agent.episode_index,
                          .episode_count = std::max(0, agent.episode_count),
                          .actions = agent.actions});
  }
  return encode(state);
}

void BatchedEnv::restore(std::string_view text) {
  Impl& in = *impl_;
  const EnvState state = decode_env_state(text);
  const auto refuse = [](const std::string& what) { throw InputError("environment state", what, "resume with the set, seed and batch it was saved with"); };
  if (state.set_hash != in.set->hash) refuse("belongs to another episode set");
  if (state.seed != in.config.seed) refuse("has another seed");
  if (state.envs.size() != in.agents.size() || state.first_env != in.first_env || state.total_envs != in.total_envs)
    refuse("belongs to another batch of environments");
  for (const EnvCursor& cursor : state.envs) {
    if (cursor.active && cursor.episode_index >= in.set->episodes.size()) refuse("names an episode that the set does not have");
    if (cursor.actions.size() > size_of(in.config.task.max_steps)) refuse("has an episode longer than task.max_steps");
  }
  in.finished.clear();
  in.started = state.started;
  if (!state.started) return;
  in.for_each_env(reset_stage, [&](std::size_t env, HearingEngines* own) { in.restore(env, state.envs[env], own); });
  in.book_stage_seconds();
}

int BatchedEnv::num_envs() const { return impl_->num_envs(); }
const EnvConfig& BatchedEnv::config() const { return impl_->config; }
std::span<const float> BatchedEnv::depth() const { return impl_->depth.now; }
std::span<const float> BatchedEnv::spectrogram() const { return impl_->spectrogram.now; }
std::span<const float> BatchedEnv::audiogoal() const { return impl_->audiogoal; }
std::span<const float> BatchedEnv::heard() const { return impl_->heard; }
std::span<const float> BatchedEnv::pointgoal() const { return impl_->pointgoal.now; }
std::span<const float> BatchedEnv::rewards() const { return impl_->rewards; }
std::span<const std::uint8_t> BatchedEnv::terminated() const { return impl_->terminated; }
std::span<const std::uint8_t> BatchedEnv::truncated() const { return impl_->truncated; }
std::span<const std::uint8_t> BatchedEnv::active() const { return impl_->active; }
std::span<const std::uint8_t> BatchedEnv::collided() const { return impl_->collided; }
std::span<const float> BatchedEnv::final_depth() const { return impl_->depth.last; }
std::span<const float> BatchedEnv::final_spectrogram() const { return impl_->spectrogram.last; }
std::span<const float> BatchedEnv::final_pointgoal() const { return impl_->pointgoal.last; }
std::span<const FinishedEpisode> BatchedEnv::finished() const { return impl_->finished; }

Pose BatchedEnv::pose(int env) const { return impl_->agents[size_of(env)].state.pose(impl_->config.task); }
const EnvSource& BatchedEnv::source(int env) const { return *impl_->agents[size_of(env)].source; }
std::uint64_t BatchedEnv::episode_index(int env) const { return impl_->agents[size_of(env)].episode_index; }
int BatchedEnv::episode_count(int env) const { return impl_->agents[size_of(env)].episode_count; }
int BatchedEnv::episode_step(int env) const { return impl_->agents[size_of(env)].state.steps(); }
const StageSeconds& BatchedEnv::stage_seconds() const { return impl_->stage_seconds; }
std::uint64_t BatchedEnv::nonfinite_events() const { return impl_->nonfinite_events; }
std::uint64_t BatchedEnv::skipped_episodes() const { return impl_->skipped_episodes; }

}  // namespace earshot
