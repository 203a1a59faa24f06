// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "bench/measure/bench_report.h"

namespace earshot {

struct SceneScaleOptions {
  int scenes = 1000, episodes_per_scene = 1;
  int num_envs = 8, threads = 1;  ///< threads: over the batch; scenes of coming episodes are loaded in one more
  double cache_gb = 2.147483648;  ///< bound of the scene cache: 2 GiB
  double minutes = 30;            ///< the steps end here, done or not
  std::uint64_t seed = 1;
  std::filesystem::path store = {};                            ///< folder of the preprocessed scenes; the first load of each writes there
  std::function<void(const std::string& line)> progress = {};  ///< empty: none
};
/// Throws InputError with key, value, rule.
void validate(const SceneScaleOptions& options);

/// A step that took much longer than the median, and what happened in it.
struct SlowStep {
  double ms = 0, reset_ms = 0;  ///< reset_ms: work of beginning episodes, summed over threads
  double cpu_ms = 0;            ///< of `ms`, what the thread that steps had a core for: the rest it waited, for other programs too
  std::uint64_t step = 0, episodes_ended = 0;
  std::uint64_t scenes_loaded = 0, sources_built = 0;  ///< by any thread while it ran: in the background too
};

/// Measurements of a run through many scenes.  Times in milliseconds.
struct SceneScaleResult {
  SceneScaleOptions options;
  std::vector<double> first_load_ms, second_load_ms;  ///< [scenes that have an episode], by SceneStore alone
  double store_mb = 0;
  std::uint64_t steps = 0, episodes = 0, scenes_loaded = 0, scenes_read = 0, scenes_built = 0;  ///< steps: of the batch
  std::vector<double> step_ms, step_cpu_ms;
  std::uint64_t slow_by_cpu = 0;  ///< steps over ten times the median of step_cpu_ms
  std::vector<SlowStep> slow;     ///< over ten times the median, slowest first
  double largest_cache_mb = 0, largest_held_mb = 0, largest_resident_mb = 0, resident_before_mb = 0;
  std::vector<std::string> refused;  ///< scenes without an episode, each with the reason
};

/// Question: how much does loading and evicting scenes delay a step?  Houses of 3 to 6 rooms with details
/// (`house:SEED,rooms=...,detail_m=0.12`),
/// each loaded twice from the store, then stepped through by a batch that follows the shortest paths, so that every episode begins in
/// another scene; all sensors, default acoustics.
SceneScaleResult run_scene_scale(const SceneScaleOptions& options);

/// A few lines: loads, steps by percentile, the slow ones with their reasons, memory.
std::string scene_scale_text(const SceneScaleResult& result);
BenchReport scene_scale_report(const SceneScaleResult& result);

}  // namespace earshot
