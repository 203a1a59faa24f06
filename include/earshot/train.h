// SPDX-License-Identifier: Apache-2.0
#pragma once

/// @file
/// Training and evaluation in this process.  Component `training`.  Run configs: docs/howto/training.md; examples lie in configs/train.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "earshot/config.h"

namespace earshot::api {

/// Every key of a run config with its value as YAML, defaults included.
/// @throws InputError for an unknown key or a value out of range; so do the functions below.
std::string run_config_text(const Config& run);

/// Draws the episodes of data.train, data.eval and, where it names a file, data.held_out, and writes their files.  Returns how many the
/// first two have.
std::pair<std::size_t, std::size_t> write_episode_sets(const Config& run);

/// How a training starts.
struct TrainOptions {
  std::filesystem::path resume = {};      ///< checkpoint or run folder to go on from; empty: a new run
  bool overwrite = false;                 ///< remove the files of an earlier run in `out` first
  std::vector<std::string> changes = {};  ///< of a resumed run: keys or sections that may differ from its checkpoint, and "engine"
};

/// What a finished training reports.
struct TrainReport {
  std::uint64_t updates = 0, env_steps = 0;
  double wall_s = 0, steps_per_s = 0;     ///< of this call
  std::filesystem::path checkpoint = {};  ///< the last one
};

/// Trains with PPO until total_steps or max_minutes: the work of one worker, on the threads of the config.  Writes checkpoints and curves
/// under `out`.  SIGTERM, SIGINT, SIGHUP and SIGUSR1 end the run after the current update, with a checkpoint.  A resumed run has the bits
/// of the unbroken one.  Several workers: the program (`earshot train --workers`, docs/howto/hosts.md).
/// @param run      run config; data.train.file must exist: write_episode_sets().
/// @param options  a new or a resumed run.
/// @throws InputError for a config or folder that cannot work, RunError if the run fails; the last good checkpoint stays.
TrainReport train(const Config& run, const TrainOptions& options = {});

/// Which episodes to evaluate and how.
struct EvaluateOptions {
  std::filesystem::path episodes = {};  ///< set to run; empty: data.eval.file of the config
  int max_episodes = 0;                 ///< the first ones only; 0: all
  int threads = 0;                      ///< 0: all cores; any number gives the same bits
  std::uint64_t seed = 0;               ///< of sampled actions
  std::filesystem::path out = {};       ///< result file (JSON) to write, for `earshot leaderboard` and `earshot verify`; empty: none
};

/// Mean of a metric over the episodes with its 95 % interval.
struct Estimate {
  std::string metric;  ///< "success", "spl", "soft_spl", "sna", ...
  double mean = 0, low = 0, high = 0;
};

/// Runs an agent on every episode of a set, once.
/// @param agent      checkpoint, run folder or policy file.
/// @param options    episodes, seed and result file.
/// @param overrides  over the agent's own config.
std::vector<Estimate> evaluate(const std::filesystem::path& agent, const EvaluateOptions& options = {}, const Settings& overrides = {});
/// The same for a baseline: random, random_oracle_stop, greedy, classical or oracle.
std::vector<Estimate> evaluate_baseline(const std::string& name, const Config& run, const EvaluateOptions& options = {});

}  // namespace earshot::api
