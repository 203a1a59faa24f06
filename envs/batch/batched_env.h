// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "envs/batch/quarantine.h"
#include "envs/config/env_config.h"
#include "envs/episodes/episode_set.h"
#include "envs/scenes/scene_cache.h"
#include "envs/sensors/sensor.h"
#include "envs/task/av_nav_task.h"
#include "sim/acoustics/paths/pose_effects.h"

namespace earshot {

/// A finished episode, with what is needed to replay it.  A quarantined one is among the finished only with EpisodeOrder::once, where it
/// counts as failed: success, SPL, SoftSPL and SNA are 0, and all numbers are finite.
struct FinishedEpisode {
  int env = 0;                      ///< global env id
  std::uint64_t episode_index = 0;  ///< in the set
  EpisodeMetrics metrics;
  std::vector<std::int8_t> actions;
  std::optional<FaultReport> fault = std::nullopt;  ///< of a quarantined episode
  int agent = 0;  ///< of the env: an episode ends for all of its agents at once, each with numbers of its own
};

/// Which of the environments under way recv() hands back.
enum class RecvOrder {
  as_ready,  ///< all that are done: which ones depends on the threads
  as_sent,   ///< the first that were sent, done or not yet: the same ones in every run
};

/// Wall seconds spent per stage since construction, summed over threads: an estimate from one step in sixteen of each env, and all resets.
struct StageSeconds {
  double move = 0, trace = 0, synthesize = 0, convolve = 0, render = 0, observe = 0, reset = 0;
};

/// Counts of a batch.
struct BatchCounters {
  StageSeconds stages;
  EffectCounters effects;  ///< poses rendered without an effect, by effect; fields built and loaded: SceneCache::field_counters()
  std::uint64_t cached_responses = 0;  ///< steps of agents that did not move (turned, collided) and reused the cached response
};

/// Where an agent is in its episode.
struct AgentPlace {
  Pose pose;                        ///< in the coordinates of the engine
  std::uint64_t episode_index = 0;  ///< in the set
  int episode_count = 0;            ///< episodes started before this one; -1: none has begun
  int episode_step = 0;
};

/// num_envs scenes with config.agents agents each, stepped together.  Buffers are flat [rows, ...], owned here, valid until the env's next
/// step; a row is one agent of one env, row = env * agents + agent.  Results depend only on the episode set, the config, the global env id
/// and the actions.  They do not depend on the number of threads, on how a batch is split, or on the order of send() calls.
///
/// Agents of one env look for the same goals.  In a step they move in the order of their numbers without passing through each other.  Then
/// each hears the sounds of the others, not its own, and sees their bodies at the new positions.  A finished agent (stop, out of steps)
/// stays in place, still sounding, inactive and with rows of zeros, until all have finished; then the episode of the env ends.
///
/// Quarantine: an episode with a fault (quarantine.h) never reaches a policy and never ends a run.  An episode that cannot begin is
/// skipped: the env draws another (`random`) or takes its next (`once`).  If a step produces a non-finite value or throws, the episode ends
/// at once
/// for all of its agents: reward 0, truncated, marked in quarantined(), all final rows zero.  The next episode starts as usual.  Buffers
/// hold finite numbers only.  A stage that exceeds config.stage_limit_s ends its episode in the same way, and the env is idle until the
/// stage returns.  reset(), step() and recv() throw InputError where 64 draws in a row cannot
/// begin, where 64 episodes of an env in a row go wrong (`random`), or where of a whole set no episode could begin (`once`).
///
/// Used by one thread at a time.  Calls throw std::logic_error, std::invalid_argument or std::out_of_range for a mistake of the caller;
/// then nothing has moved.
class BatchedEnv {
 public:
  /// Global ids are first_env ... first_env + num_envs - 1 of `total_envs` (all workers together; used by EpisodeOrder::once).
  /// scenes: must have config.acoustics.  Opens every sound of the set.  Throws InputError.
  BatchedEnv(const EnvConfig& config, std::shared_ptr<const EpisodeSet> set, std::shared_ptr<SceneCache> scenes, int num_envs,
             int first_env = 0, int total_envs = 0);

  /// Starts the first episode of every env and fills the observations.  Seeds of envs are those of the config again.
  void reset();
  /// The same for the envs whose flag is not 0; rows, flags and rewards of the others stay.  mask [num_envs].  seeds: [num_envs] or empty;
  /// an env with a seed of its own begins the first episode of that seed's sequence, which (EpisodeOrder::random) is the same in any env of
  /// any batch; without, the next episode of its own.  An env whose stage has been given up and still runs stays out of the batch.
  void reset(std::span<const std::uint8_t> mask, std::span<const std::uint64_t> seeds = {});
  /// actions: [rows] in [0, 4).  config.autoreset decides what follows an ended episode; its last observation is in the final rows.  Idle
  /// envs (EpisodeOrder::once, no episode left) and agents that wait ignore their action.
  void step(std::span<const std::int32_t> actions);

  /// Begins a step of these envs and returns: they are under way until recv() hands them back, and their rows must not be read.  envs [n],
  /// actions [n * agents]; with config.threads threads in the background.  An env under way cannot be sent.
  void send(std::span<const std::int32_t> envs, std::span<const std::int32_t> actions);
  /// Waits until recv() with these arguments would not wait; hands nothing back.  Throws as recv().
  void wait_ready(int min_ready, RecvOrder order = RecvOrder::as_ready);
  /// Waits until at least min_ready envs under way are done, and hands back all that are (as_ready) or the first min_ready sent (as_sent):
  /// by ascending number, valid until the next call.  finished() then holds their episodes.
  std::span<const std::int32_t> recv(int min_ready, RecvOrder order = RecvOrder::as_ready);

  [[nodiscard]] int num_envs() const;
  [[nodiscard]] int num_rows() const;  ///< num_envs() * config().agents
  [[nodiscard]] const EnvConfig& config() const;
  /// The sensors of the config.
  [[nodiscard]] std::span<const SensorSpec> sensors() const;
  /// Rows of a sensor by name: bytes of [rows, shape].  Empty where it is off; `waveform` and `heard` are kept where any sensor hears.
  [[nodiscard]] std::span<const std::byte> rows(std::string_view sensor) const;
  /// The same of the observations in which the episodes that ended last ended.
  [[nodiscard]] std::span<const std::byte> final_rows(std::string_view sensor) const;
  [[nodiscard]] std::span<const float> rewards() const;            ///< [rows] of the last step
  [[nodiscard]] std::span<const std::uint8_t> terminated() const;  ///< stop was called
  [[nodiscard]] std::span<const std::uint8_t> truncated() const;   ///< out of steps: bootstrap from the final observation
  [[nodiscard]] std::span<const std::uint8_t> active() const;      ///< 0: idle, or waits for the other agents
  [[nodiscard]] std::span<const std::uint8_t> collided() const;
  /// 1: the episode was quarantined in the last step.  Mask its steps in training, without a bootstrap value.
  [[nodiscard]] std::span<const std::uint8_t> quarantined() const;
  /// 1: the agent took its action in the last step.  0: idle, waiting, or the step began an episode; do not train on this row.
  [[nodiscard]] std::span<const std::uint8_t> acted() const;
  /// Episodes that ended in the last step or are of the envs that recv() handed back, by env.
  [[nodiscard]] std::span<const FinishedEpisode> finished() const;

  /// State outside the observations, for baselines and pages.  `row` counts from 0 in this batch; throws std::out_of_range for another.
  [[nodiscard]] AgentPlace agent(int row) const;
  /// The source at its goal.  Throws std::logic_error where the agent has no episode, as goal().
  [[nodiscard]] const EnvSource& source(int row) const;
  /// The goals of its episode, as far as the nearest of them; refers to what the episode holds.
  [[nodiscard]] NearestGoal goal(int row) const;
  /// Whether steps begun by send(), stages that were given up, or loads ahead (config.prefetch) go on.  From any thread, at any time,
  /// without a lock.
  [[nodiscard]] bool works_in_background() const;
  /// Sums since construction over all returned tasks.  May be called at any time.
  [[nodiscard]] BatchCounters counters() const;
  /// Episodes taken out of the run, by reason, and what became of their files.  At any time.
  [[nodiscard]] QuarantineCounters quarantine_counters() const;
  /// hook: see StageHook; empty: none.
  void set_stage_hook(StageHook hook);

  /// Ends what env `env` of the batch does and begins this episode of the set there, as that env's episode number `episode_count`: replays.
  /// stream: the global env id whose draws this episode has; the next one is then the next of the env's own sequence.  By default that of
  /// the env, which goes on from episode_count.
  /// Returns what is wrong if it cannot begin.  The env is idle then; after a stall only until the stage returns, when it begins another
  /// episode.  Throws std::out_of_range or std::invalid_argument for an env, an episode or a number that does not exist, and
  /// std::logic_error while a stage of that env that was given up still runs.
  std::optional<FaultReport> begin(int env, std::uint64_t episode_index, int episode_count, std::optional<std::uint32_t> stream = {});
  /// Puts the agent of env `env` on the nearest floor to a foot point (in the coordinates of the scene's file), at the time of the end of
  /// step `steps` of its episode, and fills the observation as if it had stood there before.  Rewards and flags are zero, the path so far
  /// stays. The env cannot be saved until its next episode begins.  Throws InputError for a place off the floor or without a way to the
  /// goal, and std::logic_error for an env with several agents or without a running episode; then nothing has moved.
  void place(int env, const Pose& pose, int steps);

  /// Cursors and actions of all running episodes; restore() replays them, which gives the same bits in all observations.  Rewards and flags
  /// of the last step are not part of it.  restore throws InputError if the state is damaged or is of another set, seed or batch.
  [[nodiscard]] std::string save_state() const;
  void restore(std::string_view state);
  /// The same for one env.  A snapshot can be restored in any env of any batch with the same set and config.
  [[nodiscard]] std::string snapshot(int env) const;
  void restore(int env, std::string_view snapshot);

 private:
  struct Impl;
  /// Waits for the threads.  Keeps the memory of a stage that was given up and still runs.
  struct Release {
    void operator()(Impl* impl) const noexcept;
  };
  std::unique_ptr<Impl, Release> impl_;
};

/// BatchedEnv::rows() and final_rows() of a sensor of float32.
inline std::span<const float> float_rows(const BatchedEnv& env, std::string_view sensor) { return as_floats(env.rows(sensor)); }
inline std::span<const float> final_float_rows(const BatchedEnv& env, std::string_view sensor) { return as_floats(env.final_rows(sensor)); }

}  // namespace earshot
