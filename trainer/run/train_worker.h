#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "policy/actor_critic.h"
#include "trainer/checkpoint/env_places.h"
#include "trainer/checkpoint/run_state.h"
#include "trainer/learner/ppo.h"
#include "trainer/rollout/episode_window.h"
#include "trainer/rollout/preemption.h"
#include "trainer/rollout/rollout_collector.h"
#include "trainer/rollout/stage_times.h"
#include "trainer/run/run_config.h"
#include "trainer/run/run_files.h"
#include "trainer/run/train_loop.h"

namespace earshot {

/// Everything one worker holds during a run: the inside of train() (train_loop.h), for its three files only.
class TrainWorker {
 public:
  TrainWorker(const RunConfig& config, Collective& collective, const std::filesystem::path& resume, const std::vector<std::string>& changes,
              const TrainHooks& hooks);

  TrainReport run();

 private:
  // train_loop.cpp: the loop, what it starts from, and when it ends
  void restore(const std::filesystem::path& path);
  void check_equal_weights();
  bool finished();
  void update();
  std::uint64_t collected_steps();
  UpdateStats learn();

  // train_worker_recovery.cpp: members that leave and come
  /// Weights and optimizer, as copies.
  [[nodiscard]] Checkpoint learner_state();
  void load_learner(const Checkpoint& learner, const std::string& where);
  void begin_other_episodes();
  void remember();
  void go_back();
  [[nodiscard]] std::string state();
  void take_state(const std::string& bytes);
  bool agree_on_state();
  void recover(const MembershipChange& change);
  void leave_files();
  void brief();

  // train_worker_report.cpp: what is said and written of an update
  void note(UpdateStats stats);
  void report(const UpdateStats& stats, double update_s, std::uint64_t steps);
  void save(bool last);

  /// Of this worker's clock: rank 0's holds for all.
  [[nodiscard]] double own_progress() const {
    const double by_steps = static_cast<double>(env_steps_) / static_cast<double>(config_.total_steps);
    const double by_time = config_.schedule == Schedule::minutes ? total_elapsed_s() / (60 * config_.max_minutes) : 0;
    return std::min(1.0, std::max(by_steps, by_time));
  }
  [[nodiscard]] double total_elapsed_s() const { return elapsed_before_s_ + elapsed_s_; }
  /// Wall time that max_minutes bounds: of this sitting, or with a schedule of minutes of the whole run.
  [[nodiscard]] double bounded_s() const { return config_.schedule == Schedule::minutes ? total_elapsed_s() : elapsed_s_; }
  [[nodiscard]] std::uint64_t steps_per_update() const {
    return static_cast<std::uint64_t>(config_.rollout_steps) * static_cast<std::uint64_t>(config_.envs_per_worker) *
           static_cast<std::uint64_t>(world_);
  }

  /// The whole update before the one under way: what is left of it when a worker is lost.
  struct Before {
    std::uint64_t update = 0, env_steps = 0;
    Checkpoint learner;  ///< weights and optimizer
    GuardCounts guards;
    int updates_without_step = 0;
  };

  const RunConfig& config_;
  Collective& collective_;
  int rank_, world_;
  std::optional<Checkpoint> resumed_;  ///< until it is restored
  bool joins_;                         ///< has not got the state of the run yet
  JoinBriefing briefing_;
  const EnvPlaces places_;  ///< by rank at this start
  std::shared_ptr<const EpisodeSet> set_;
  std::shared_ptr<SceneCache> scenes_;
  BatchedEnv env_;
  ActorCritic policy_;
  PpoLearner learner_;
  RolloutCollector collector_;
  Preemption preemption_;

  std::uint64_t update_ = 0, env_steps_ = 0;
  bool collected_ = false;  ///< the rollout of the update under way is there
  bool learning_ = false;   ///< the weights are in the midst of an update
  std::optional<Before> before_;
  bool lost_since_report_ = false;
  bool joiners_ = false;  ///< some are ready
  EpisodeSums finished_;
  EpisodeWindow window_;
  StageTimes times_;  ///< this update, this worker
  std::filesystem::path last_checkpoint_;
  std::optional<RunFiles> files_;  ///< rank 0's
  RunCounters counters_;           ///< of all workers
  GuardCounts guards_;
  int updates_without_step_ = 0;  ///< in a row
  std::uint64_t ratio_alarms_ = 0;
  LapTimer clock_;
  double own_step_s_ = 0;                        ///< seconds of this worker's rollout
  double elapsed_s_ = 0, elapsed_before_s_ = 0;  ///< in this sitting, and in those before
  std::uint64_t steps_before_ = 0;               ///< env_steps_ with which this sitting began
  double progress_ = 0;                          ///< of all workers, in [0, 1]
};

}  // namespace earshot
