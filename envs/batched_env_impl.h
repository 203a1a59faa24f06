#pragma once

// The inside of BatchedEnv, shared by its four files: batched_env.cpp (construction and the public calls), env_stages.cpp (what a step
// does for one env), env_episodes.cpp (how episodes begin, end and are restored) and env_faults.cpp (how they are quarantined).

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <array>
#include <atomic>
#include <chrono>

#include "envs/agent_hearing.h"
#include "envs/batched_env.h"
#include "envs/env_state.h"
#include "envs/oracle_counts.h"
#include "envs/sound_library.h"
#include "sim/base/denormals.h"
#include "sim/base/errors.h"
#include "sim/vision/ray_renderer.h"

namespace earshot {

enum Stage : std::size_t {
  move_stage,
  trace_stage,
  synthesize_stage,
  convolve_stage,
  render_stage,
  observe_stage,
  reset_stage,
  num_stages
};

/// Everything that belongs to one agent and is not an observation.
struct Agent {
  bool depth_is_current = false;
  std::uint64_t episode_index = 0;
  int episode_count = -1;  // none begun
  std::shared_ptr<const EnvSource> source;
  AvNavState state;
  AgentHearing hearing;
  Pose rendered_pose;
  std::vector<std::int8_t> actions;            // since the start of the episode
  std::optional<FaultReport> fault;            // of this episode: its stages are skipped until it is quarantined, in this very step
  int faulty_in_a_row = 0;                     // episodes that went wrong in a step, since one that did not
  std::vector<FinishedEpisode> failed_starts;  // order `once`: not yet among the finished
  std::array<double, num_stages> seconds{};
};

inline std::size_t size_of(int count) { return static_cast<std::size_t>(count); }

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

struct BatchedEnv::Impl {
  EnvConfig config;
  std::shared_ptr<const EpisodeSet> set;
  std::shared_ptr<SceneCache> scenes;
  int first_env, total_envs;
  int block_samples;
  OracleCounts oracle;
  SoundLibrary sounds;
  RayRenderer renderer;
  std::vector<Agent> agents;
  std::vector<HearingEngines> engines;   // one per thread
  std::optional<tbb::task_arena> arena;  // none: the caller's thread does all
  bool started = false;

  SensorRows depth, spectrogram, pointgoal;
  std::vector<float> audiogoal, heard, rewards;
  std::vector<std::uint8_t> terminated, truncated, active, collided, quarantined;
  std::vector<FinishedEpisode> finished;
  StageSeconds stage_seconds;
  Quarantine quarantine;
  StageHook hook;
  std::atomic<std::uint64_t> begun{0}, failed{0};  // episodes

  Impl(const EnvConfig& env_config, std::shared_ptr<const EpisodeSet> episodes, std::shared_ptr<SceneCache> cache, int num_envs, int first,
       int total);

  int num_envs() const { return static_cast<int>(agents.size()); }
  std::uint32_t global_id(std::size_t env) const { return static_cast<std::uint32_t>(first_env) + static_cast<std::uint32_t>(env); }
  bool ended(std::size_t env) const { return terminated[env] || truncated[env]; }
  /// Whether the env has an episode that goes on.
  bool runs(std::size_t env) const { return active[env] && !agents[env].fault; }
  const Episode& episode_of(const Agent& agent) const { return set->episodes[agent.episode_index]; }
  std::span<float> sound_row(std::vector<float>& rows, std::size_t env) const {
    const std::size_t size = rows.size() / agents.size();
    return std::span(rows).subspan(env * size, size);
  }

  /// Runs body(env, engines of this thread) for every env, and books its time to `stage`.
  template <class Body>
  void for_each_env(Stage stage, const Body& body);
  /// The same for envs that run; one in which body throws an InputError or a RunError has a fault.
  template <class Body>
  void for_each_running_env(Stage stage, const Body& body);

  // The stages of a step; each reads poses and writes one row of its buffer.  own: engines of this thread, null for an agent without a
  // spectrogram.
  void move(std::size_t env, Action action);
  void trace(std::size_t env);
  void synthesize(std::size_t env, HearingEngines* own);
  void convolve(std::size_t env, HearingEngines* own);
  void render(std::size_t env);
  void observe(std::size_t env, HearingEngines* own);
  void restart(std::size_t env, HearingEngines* own);

  std::optional<std::uint64_t> draw_episode(std::size_t env, int episode_count, std::uint32_t attempt) const;
  void begin_next_episode(std::size_t env, HearingEngines* own);
  /// Sets the agent's fault if the episode cannot begin.
  void begin_episode(std::size_t env, std::uint64_t episode_index, int episode_count, HearingEngines* own);
  void prepare_episode(std::size_t env, std::uint64_t episode_index, int episode_count);
  void enter_episode(std::size_t env);
  void go_idle(std::size_t env);
  void observe_start(std::size_t env, HearingEngines* own);
  void restore(std::size_t env, const EnvCursor& cursor, HearingEngines* own);
  /// Notes a fault of the running episode; the first one stays.
  void report(std::size_t env, Fault fault, std::string detail);
  /// Calls the hook with `values`, then reports the fault if one is not finite.
  bool check(std::size_t env, Fault kind, std::span<float> values);
  void clear_rows(std::size_t env);
  void quarantine_episode(std::size_t env);
  FinishedEpisode failed_episode(std::size_t env) const;
  void end_faulty_episode(std::size_t env);
  bool collect_finished();
  void stop_if_none_begins() const;
  void book_stage_seconds();
};

template <class Body>
void BatchedEnv::Impl::for_each_env(Stage stage, const Body& body) {
  const auto run = [&](std::size_t env, std::size_t thread) {
    const FlushDenormals flush;  // here and not around the loop: TBB gives tasks the setting of the thread that made the arena
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

template <class Body>
void BatchedEnv::Impl::for_each_running_env(Stage stage, const Body& body) {
  for_each_env(stage, [&](std::size_t env, HearingEngines* own) {
    if (!runs(env)) return;
    try {
      body(env, own);
    } catch (const InputError& error) {
      report(env, Fault::stage, error.what());
    } catch (const RunError& error) {
      report(env, Fault::stage, error.what());
    }
  });
}

}  // namespace earshot
