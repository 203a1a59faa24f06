// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/checkpoint/run_claim.h"
#include "trainer/checkpoint/run_state.h"
#include "trainer/collective/worker_updates.h"
#include "trainer/learner/ppo.h"
#include "trainer/rollout/episode_window.h"
#include "trainer/rollout/run_counters.h"
#include "trainer/rollout/stage_times.h"
#include "trainer/run/run_files.h"
#include "trainer/run/run_progress.h"

namespace earshot {

/// One worker's part of the report of an update.
struct WorkerSums {
  EpisodeSums episodes;  ///< that ended since the last report
  StageTimes times;      ///< since the last report
  RunCounters counters;  ///< since the worker began
};

/// Log lines, curve points and checkpoints of a run, and the counts they show: guards, counters, the window of recent episodes.
///
/// Every worker keeps the counts, as any may become rank 0; rank 0 alone logs and writes.  A write that fails is counted
/// (GuardCounts::failed_writes) and the run goes on, but for the last checkpoint.
class UpdateReport {
 public:
  /// config, collective, progress: must outlive this.  claim: on config.out; the default one claims nothing.
  UpdateReport(const RunConfig& config, Collective& collective, const RunProgress& progress, RunClaim claim = {});

  /// Of rank 0, before report() and save(): takes the claim.  False where the files are open already.
  bool open_files();
  /// Of a worker that has written the run, once a lower one has joined: waits for the checkpoint that is on its way, gives the claim up.
  void close_files();

  /// Counts what the guards of one update did, and logs the first skips and alarms.  Returns the reason where the run has to end, as too
  /// many updates in a row took no optimizer step.
  [[nodiscard]] std::optional<std::string> note(UpdateStats stats);
  /// Progress line and curve point.  A collective call.  worker_updates: gather_worker_updates().
  void report(const UpdateStats& stats, const WorkerSums& worker_sums, const std::vector<WorkerUpdate>& worker_updates, double steps_per_s);
  [[nodiscard]] const HeldOutState& held_out() const { return held_out_; }
  /// After an evaluation, the same on every worker.
  void set_held_out(const HeldOutState& state) { held_out_ = state; }
  /// Progress line and curve point of the last evaluation, on rank 0.
  void show_held_out(const HeldOutScores& scores);
  /// Of a checkpoint, for evaluations on `set` from here on (state_for_set).
  void restore_held_out(const std::optional<HeldOutState>& saved, const std::string& set);
  /// How far the run is and what its episodes came to, into a checkpoint of the update that has just been reported.
  void describe_state(Checkpoint& checkpoint) const;
  /// Of rank 0: writes the checkpoint.  checkpoint: learner and environments of all workers, described; the rest is filled in here.  Throws
  /// RunError if the last one cannot be written.
  void save(Checkpoint checkpoint, bool is_last);
  /// Of rank 0: whether the last periodic checkpoint could not be written.
  [[nodiscard]] bool owes_checkpoint() { return files_ && files_->owes_checkpoint(); }
  /// Of a worker whose run ends by an error: writes that state, unless it or a later one is on disk.  Another than rank 0 first lets
  /// those before it do so.  Not collective.  Throws RunError if it cannot be written.
  void salvage(Checkpoint whole);

  /// Members that are lost or have joined.
  void note_members(const MembershipChange& change);
  /// Raises the counts to those of a worker that has seen a change which this one has not.
  void raise_member_counts(std::uint64_t lost, std::uint64_t joined);
  /// Totals are of fewer workers from here on: the next point gives no difference to those before.
  void note_loss() { lost_since_report_ = true; }
  /// To the counts of an earlier update.  Members that left or came, and files that were not written, stay counted.
  void go_back(const GuardCounts& guards, int updates_without_step);

  void restore_window(const Checkpoint& checkpoint);
  /// Guards, counters, window and evaluations, as another worker gets or has sent them.
  void write_to(RunState& state) const;
  void set_state(const RunState& state);

  [[nodiscard]] const GuardCounts& guards() const { return guards_; }
  [[nodiscard]] const RunCounters& counters() const { return counters_; }  ///< of all workers
  [[nodiscard]] int updates_without_step() const { return updates_without_step_; }
  [[nodiscard]] std::uint64_t ratio_alarms() const { return ratio_alarms_; }  ///< of this worker
  [[nodiscard]] const std::filesystem::path& last_checkpoint() const { return last_checkpoint_; }

 private:
  void log_guards(const UpdateStats& stats) const;
  void complete(Checkpoint& checkpoint) const;
  void show_progress(const EpisodeSums& recent, const StageTimes& mean, double steps_per_s) const;

  const RunConfig& config_;
  Collective& collective_;
  const RunProgress& progress_;
  RunClaim claim_;
  std::optional<RunFiles> files_;
  EpisodeWindow window_;
  RunCounters counters_;
  GuardCounts guards_;
  HeldOutState held_out_;
  int updates_without_step_ = 0;  ///< in a row
  std::uint64_t ratio_alarms_ = 0;
  bool lost_since_report_ = false;
  std::filesystem::path last_checkpoint_;
};

}  // namespace earshot
