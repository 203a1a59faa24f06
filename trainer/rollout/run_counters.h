// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace earshot {

class BatchedEnv;
class SceneCache;

/// Counters of the environments and the rollout since the worker began; in double, so that all workers' counts add up
/// by all-reduce (exact up to 2^53).
struct RunCounters {
  enum Field {
    poses,                 ///< heard: one per env step and episode start
    in_sight,              ///< of these, with a free line of sight
    without_transmission,  ///< of these, heard without an effect that the plan found not to matter (docs/explanation/effect_plan.md)
    without_diffraction,
    without_early,
    without_late,
    from_field,  ///< of these, with late sound gathered from a source field
    cached,      ///< steps of agents that did not move: the cached response was used
    fields_built,
    fields_loaded,  ///< from env.field_store
    fields_shared,  ///< asked for while they were in memory
    field_bytes,
    field_seconds,  ///< building and loading, summed over threads
    quarantined,    ///< episodes taken out of the run
    without_path,   ///< of these, for want of a path to the goal
    not_finite,     ///< of these, because something was not finite
    quarantine_files,
    quarantine_files_failed,
    sanitized_rows,  ///< observations and hidden states that were not finite when the policy was to see them
    dropped_rows,    ///< rewards and values that were not finite when the learner was to have them
    ratio_alarms,    ///< updates whose first ratio was off by more than kMaxRatioError (trainer/learner/ppo.h)
    num_fields
  };
  std::array<double, num_fields> values{};

  static RunCounters of(const BatchedEnv& env, const SceneCache& scenes, std::uint64_t num_sanitized_rows, std::uint64_t num_dropped_rows,
                        std::uint64_t num_ratio_alarms);
  [[nodiscard]] double operator[](Field field) const { return values[field]; }
};

/// Counters of optimizer steps and of the run's files; the same on every worker, but for the files, which are rank 0's.
struct GuardCounts {
  std::uint64_t taken_steps = 0, skipped_steps = 0, loss_alarms = 0, kl_alarms = 0;
  std::uint64_t failed_writes = 0;   ///< curve points and periodic checkpoints that could not be written
  std::uint64_t lost_workers = 0;    ///< without which the others went on
  std::uint64_t joined_workers = 0;  ///< that came to the run under way
};

/// Curve points: fractions of the poses heard since `before` under hearing/, totals under fields/ and guards/.
void append_curve_values(std::vector<std::pair<std::string, double>>& values, const RunCounters& now, const RunCounters& before,
                         const GuardCounts& guards);
/// "2 episodes quarantined, 1 step skipped"; empty if nothing happened.
std::string fault_summary(const RunCounters& counters, const GuardCounts& guards);
/// Three lines: hearing, fields, guards.
std::string summary(const RunCounters& counters, const GuardCounts& guards);

}  // namespace earshot
