#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "envs/av_nav_task.h"
#include "envs/env_config.h"
#include "envs/episode_set.h"
#include "envs/quarantine.h"
#include "envs/scene_cache.h"
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
};

/// Wall seconds spent per stage since construction, summed over threads.
struct StageSeconds {
  double move = 0, trace = 0, synthesize = 0, convolve = 0, render = 0, observe = 0, reset = 0;
};

/// num_envs agents stepped together.  Buffers are flat [num_envs, ...], owned here, valid until the next step.  Results are a function of
/// (set, config, global env id): not of threads, nor of how a batch is split.
///
/// Quarantine: an episode with a fault (quarantine.h) never reaches a policy and never ends a run.  One that cannot begin is skipped:
/// the env draws another (`random`) or takes its next (`once`).  One that goes wrong in a step ends in that step: reward 0, truncated,
/// marked in quarantined(), all final_* rows zero; the env begins its next episode in the same call.  Buffers hold finite numbers only.
/// reset() and step() throw InputError where 64 draws in a row cannot begin, where 64 episodes of an env in a row go wrong (`random`), or
/// where of a whole set no episode could begin (`once`).
class BatchedEnv {
 public:
  /// Global ids are first_env ... first_env + num_envs - 1 of `total_envs` (all workers together; used by EpisodeOrder::once).
  /// scenes: must have config.acoustics.  Opens every sound of the set.  Throws InputError.
  BatchedEnv(const EnvConfig& config, std::shared_ptr<const EpisodeSet> set, std::shared_ptr<SceneCache> scenes, int num_envs,
             int first_env = 0, int total_envs = 0);
  ~BatchedEnv();

  /// Starts the first episode of every env and fills the observations.
  void reset();
  /// actions: [num_envs] in [0, 4).  An env whose episode ends starts its next episode in the same call: the row of observations is
  /// then the new episode's first, and the ended one's last observation is in the final_* row.  Idle envs (EpisodeOrder::once, no episode
  /// left) ignore their action.  Throws std::invalid_argument for another number of actions or an action out of range, std::logic_error
  /// before the first reset(); then nothing has moved.
  void step(std::span<const std::int32_t> actions);

  [[nodiscard]] int num_envs() const;
  [[nodiscard]] const EnvConfig& config() const;
  [[nodiscard]] std::span<const float> depth() const;  ///< [num_envs, height, width, 1]
  /// A sensor that is off has an empty span.  No spectrogram: nothing is rendered for the ears, and audiogoal and heard are empty too.
  [[nodiscard]] std::span<const float> spectrogram() const;        ///< [num_envs, 65, 26, 2]
  [[nodiscard]] std::span<const float> audiogoal() const;          ///< [num_envs, 2, new samples]: this step's sound
  [[nodiscard]] std::span<const float> heard() const;              ///< [num_envs, 2, window]: the last second
  [[nodiscard]] std::span<const float> pointgoal() const;          ///< [num_envs, 2] or empty
  [[nodiscard]] std::span<const float> rewards() const;            ///< [num_envs] of the last step
  [[nodiscard]] std::span<const std::uint8_t> terminated() const;  ///< stop was called
  [[nodiscard]] std::span<const std::uint8_t> truncated() const;   ///< out of steps: bootstrap from the final observation
  [[nodiscard]] std::span<const std::uint8_t> active() const;      ///< 0: idle
  [[nodiscard]] std::span<const std::uint8_t> collided() const;
  /// 1: the episode was quarantined in the last step.  Its steps are no experience: mask them, without a bootstrap value.
  [[nodiscard]] std::span<const std::uint8_t> quarantined() const;
  [[nodiscard]] std::span<const float> final_depth() const;  ///< like depth(); row valid where terminated or truncated
  [[nodiscard]] std::span<const float> final_spectrogram() const;
  [[nodiscard]] std::span<const float> final_pointgoal() const;
  /// Episodes that ended in the last step, by env.
  [[nodiscard]] std::span<const FinishedEpisode> finished() const;

  /// For baselines and pages: state that is no observation.  `env` counts from 0 in this batch; throws std::out_of_range for another.
  [[nodiscard]] Pose pose(int env) const;
  [[nodiscard]] const EnvSource& source(int env) const;
  [[nodiscard]] std::uint64_t episode_index(int env) const;
  [[nodiscard]] int episode_count(int env) const;  ///< episodes started before this one
  [[nodiscard]] int episode_step(int env) const;
  [[nodiscard]] const StageSeconds& stage_seconds() const;
  /// Poses rendered without an effect, by effect, summed over agents since construction.  Fields built and loaded:
  /// SceneCache::field_counters().
  [[nodiscard]] EffectCounters effect_counters() const;
  /// Steps of agents that did not move (turned, collided): they reuse the cached response.
  [[nodiscard]] std::uint64_t cached_responses() const;
  /// Episodes taken out of the run, by reason, and what became of their files.
  [[nodiscard]] QuarantineCounters quarantine_counters() const;
  /// Of them: those where something was not finite.
  [[nodiscard]] std::uint64_t nonfinite_events() const;
  /// Of them: those without a path to their goal.
  [[nodiscard]] std::uint64_t skipped_episodes() const;
  /// hook: see StageHook; empty: none.
  void set_stage_hook(StageHook hook);

  /// Ends what env `env` of the batch does and begins this episode of the set there, as that env's episode number `episode_count`: replays.
  /// Returns what is wrong if it cannot begin; the env is idle then.  Throws std::out_of_range or std::invalid_argument for an env, an
  /// episode or a number that does not exist.
  std::optional<FaultReport> begin(int env, std::uint64_t episode_index, int episode_count);

  /// Cursors and actions of all running episodes; restore() replays them, which gives the same bits in all observations.  Rewards and flags
  /// of the last step are not part of it.  restore throws InputError if the state is damaged or is of another set, seed or batch.
  [[nodiscard]] std::string save_state() const;
  void restore(std::string_view state);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace earshot
