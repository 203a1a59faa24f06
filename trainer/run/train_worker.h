// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "policy/policy_network.h"
#include "trainer/checkpoint/env_places.h"
#include "trainer/checkpoint/run_state.h"
#include "trainer/learner/ppo.h"
#include "trainer/rollout/preemption.h"
#include "trainer/rollout/rollout_collector.h"
#include "trainer/run/recovery.h"
#include "trainer/run/run_config.h"
#include "trainer/run/run_progress.h"
#include "trainer/run/train_loop.h"
#include "trainer/run/update_report.h"

namespace earshot {

/// Start of a worker: a new run, a checkpoint, or a run under way that it joins.
struct WorkerStart {
  std::optional<Checkpoint> resumed;
  JoinBriefing briefing;  ///< of a worker that joins
  EnvPlaces places;       ///< by rank at this start
};
/// resume: a checkpoint, empty for none.  changes: RunStart::changes.  Throws as load_checkpoint, env_places_of and decode_briefing.
WorkerStart worker_start(const Collective& collective, const std::filesystem::path& resume, const std::vector<std::string>& changes);

/// The inside of train() (train_loop.h): collects a rollout, learns from it, reports, saves, until the workers agree that the run ends;
/// after a MembershipChange Recovery brings them back to one state.
class TrainWorker {
 public:
  /// config, collective: must outlive this.  resume: path of start.resumed, for errors.  claim: on config.out.  Throws InputError if the
  /// checkpoint does not fit, RunError if the workers' weights differ.
  TrainWorker(const RunConfig& config, Collective& collective, WorkerStart start, const std::filesystem::path& resume, RunClaim claim,
              const TrainHooks& hooks);

  TrainReport run();

 private:
  void restore(const Checkpoint& checkpoint, const std::filesystem::path& path);
  void join(const JoinBriefing& briefing);

  void make_updates();
  [[nodiscard]] HeldOutVote held_out_vote() const;
  void evaluate();
  void update();
  void collect();
  std::uint64_t collected_steps();
  UpdateStats learn();
  void report(const UpdateStats& stats, double update_s, std::uint64_t steps);
  void keep_whole_update(bool with_environments);
  void save(bool is_last);
  bool rolls_back();
  void salvage() noexcept;

  [[nodiscard]] int rank() const { return collective_.identity().rank; }
  /// Whether each worker keeps the environments of all after each update: of more workers that would be too much.
  [[nodiscard]] bool keeps_environments() const { return collective_.identity().world_size <= kMaxMeshWorkers; }
  /// Global number of this worker's first env.  While ranks are those of the start: before any change of members.
  [[nodiscard]] int first_env() const { return places_.first_of(rank()) * config_.envs_per_worker; }

  const RunConfig& config_;
  Collective& collective_;
  const EnvPlaces places_;
  std::shared_ptr<const EpisodeSet> set_;
  std::shared_ptr<SceneCache> scenes_;
  BatchedEnv env_;
  PolicyNetwork policy_;
  PpoLearner learner_;
  RolloutCollector collector_;
  Preemption preemption_;
  RunProgress progress_;
  UpdateReport report_;
  Recovery recovery_;
  HeldOutEvaluator* held_out_;

  WorkerSums sums_;       ///< episodes and times since the last report
  double collect_s_ = 0;  ///< wall time of the last rollout, which recovery may have learned from once more
  /// State after the last whole update, the same on every worker; where they are too many without the environments of the others.
  std::optional<Checkpoint> whole_;
  int roll_backs_ = 0;
};

}  // namespace earshot
