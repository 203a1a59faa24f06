// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "bench/measure/statistics.h"
#include "bench/soak/watch.h"

namespace earshot {

struct SoakResult;

struct SoakOptions {
  std::uint64_t steps = 1'000'000;  ///< agent steps
  int scenes = 200, hard_every = 5;
  int num_envs = 16, threads = 0;  ///< threads 0: all cores
  double minutes = 120;            ///< the steps end here, done or not
  std::uint64_t seed = 1;
  int camera_px = 32;             ///< a small picture: rendering shall not hide the rest
  double cache_mb = 128;          ///< bound of the scene cache: below the total size of the scenes, so that it evicts
  int replays = 20;               ///< episodes that are run again cold
  double memory_limit_mib = 1;    ///< allowed growth of resident memory per 100,000 steps after the warm-up
  SoakWatch::Tamper tamper = {};  ///< for tests of the soak itself
  /// Called with what is known so far, about twenty times in a run: a soak that is killed leaves its report.
  std::function<void(const SoakResult&)> on_progress = {};
};
/// Throws InputError with key, value, rule.
void validate(const SoakOptions& options);

enum class BoundStatus { held, broken, open };

/// One thing that must hold, and whether it did; open: the run was too short to say.
struct SoakBound {
  std::string name, found, bound;
  BoundStatus status = BoundStatus::held;
};

/// Of a call of BatchedEnv::step, milliseconds: wall time of all, and work per stage summed over agents and threads.
inline constexpr std::array<const char*, 8> kSoakStages{"step", "move", "trace", "synthesize", "convolve", "render", "observe", "reset"};

struct SoakResult {
  SoakOptions options;
  int threads = 1, rounds = 0;  ///< rounds through all scenes, the last one possibly incomplete
  std::uint64_t steps = 0, episodes = 0, successes = 0;
  double seconds = 0, cpu_seconds = 0;  ///< of the steps, watching included
  bool finished = false;                ///< false: a report in between
  std::string failure;                  ///< reason why the run stopped; empty: none
  std::vector<std::string> refused_scenes;
  std::size_t episodes_per_scene = 0, num_episodes_in_set = 0;

  std::array<std::uint64_t, kNumSoakFaults> faults{};
  std::vector<SoakWatch::Example> examples;
  std::array<SoakWatch::KindTotals, kNumSoakKinds> kinds{};
  LogHistogram loudness;
  double largest_reward = 0;
  std::uint64_t nonfinite_events = 0, cached_responses = 0;
  QuarantineCounters quarantined;

  std::array<LogHistogram, kSoakStages.size()> stage_ms;
  std::vector<MemorySample> memory;
  std::uint64_t warm_up_steps = 0;            ///< slopes are of the samples after these
  bool all_scenes_before = false;             ///< in the warm-up every scene was loaded
  Slope resident_slope, heap_slope;           ///< MiB per agent step
  double cache_bound = 0, largest_cache = 0;  ///< MiB
  std::uint64_t evicted_scenes = 0;

  int replayed = 0, replays_that_differ = 0;
  std::vector<std::string> differing;

  [[nodiscard]] std::vector<SoakBound> bounds() const;
  [[nodiscard]] bool passed() const;  ///< no bound is broken
};

/// Walks a batch of environments through generated scenes for a given number of agent steps, half of the episodes at random and half
/// greedily, and watches what comes out, its time and its memory.  Acoustics and task are those of
/// configs/train/quick.yaml.
SoakResult run_soak(const SoakOptions& options);

}  // namespace earshot
