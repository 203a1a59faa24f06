// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "trainer/collective/collective.h"
#include "trainer/rollout/stage_times.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// Counts and times of a run between two updates.
struct RunPosition {
  std::uint64_t update = 0, env_steps = 0;     ///< whole updates, and steps of all workers in them
  std::uint64_t steps_before = 0;              ///< env_steps at the start of this sitting
  double elapsed_s = 0, elapsed_before_s = 0;  ///< of this sitting, and of those before
};

/// Decisions of rank 0 about an update, beside the end of the run by steps or time (held_out_state.h).
struct HeldOutVote {
  bool evaluates = false;    ///< the weights, before anything else
  bool has_stopped = false;  ///< learning: the run is done
};

/// Progress of a run, its elapsed time and its end.  A sitting is the time from one start or resume of the run to its end.
///
/// Every worker holds the same update and env_steps; elapsed times are of each worker's own clock, and agree_on_end() makes rank 0's hold
/// for all.  The order in one update: note_rollout(), then complete_update() after the optimizer steps; go_back() undoes complete_update().
class RunProgress {
 public:
  /// Bounds and schedule: total_steps, max_minutes, schedule.  config: must outlive this.
  explicit RunProgress(const RunConfig& config);

  [[nodiscard]] const RunPosition& position() const { return position_; }
  [[nodiscard]] std::uint64_t update() const { return position_.update; }
  [[nodiscard]] std::uint64_t env_steps() const { return position_.env_steps; }
  /// Goes on from a checkpoint, or from the position of another worker.
  void set_position(const RunPosition& position) { position_ = position; }
  /// To the end of an earlier update.  Times stay; the rollout that followed that update stays to be learned from again.
  void go_back(std::uint64_t update, std::uint64_t env_steps);

  /// The first update's time counts from here.
  void start_clock() { clock_.lap(); }
  /// A collective call: whether the run ends here, the same on every worker.  It does where any worker has got a stop signal or all its
  /// steps, or rank 0's clock has reached max_minutes or its vote says so.  False where an evaluation comes first: evaluates(), as rank 0's
  /// vote says, but for a stop signal and the end of max_minutes.  Sets fraction() and has_joiners().
  bool agree_on_end(Collective& collective, HeldOutVote vote = {});
  /// Of the last agree_on_end().
  [[nodiscard]] bool evaluates() const { return evaluates_; }
  /// Of the whole training, in [0, 1], for decays and guidance; of the last agree_on_end().
  [[nodiscard]] double fraction() const { return fraction_; }
  /// The signal that ended the run before it was done, of the last agree_on_end(), the same on every worker: SIGINT, or SIGTERM for any
  /// other; 0: none, or it has made all its steps.
  [[nodiscard]] int end_signal() const { return end_signal_; }
  /// Whether workers were ready to join at the last agree_on_end().
  [[nodiscard]] bool has_joiners() const { return has_joiners_; }

  /// Whether the rollout of the update under way is complete.
  [[nodiscard]] bool has_rollout() const { return has_rollout_; }
  void note_rollout() { has_rollout_ = true; }
  /// steps: of all workers in this update.  Returns its wall time, which is added to elapsed_s.
  double complete_update(std::uint64_t steps);
  /// Adds the time since then to elapsed_s, and to no update: of an evaluation.
  void complete_evaluation() { position_.elapsed_s += clock_.lap(); }

  /// Over all sittings.
  [[nodiscard]] double total_elapsed_s() const { return position_.elapsed_before_s + position_.elapsed_s; }
  /// Mean of this sitting; 0 before its first update.
  [[nodiscard]] double steps_per_s() const;
  /// Expected wall time to the end of the run.
  [[nodiscard]] double remaining_s(double steps_per_s) const;

 private:
  /// Of this worker's clock.
  [[nodiscard]] double own_fraction() const;
  /// Wall time that max_minutes bounds: of this sitting, or with a schedule of minutes of the whole run.
  [[nodiscard]] double bounded_s() const;

  const RunConfig& config_;
  RunPosition position_;
  LapTimer clock_;
  double fraction_ = 0;
  int end_signal_ = 0;
  bool has_joiners_ = false;
  bool evaluates_ = false;
  bool has_rollout_ = false;
};

}  // namespace earshot
