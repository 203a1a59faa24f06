// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "policy/policy_network.h"
#include "trainer/checkpoint/checkpoint.h"
#include "trainer/checkpoint/env_places.h"
#include "trainer/learner/ppo.h"
#include "trainer/rollout/run_counters.h"
#include "trainer/run/run_progress.h"
#include "trainer/run/update_report.h"

namespace earshot {

/// A collective call.  Throws RunError if the weights are not the same bits on every worker.
void check_equal_weights(Collective& collective, const PolicyNetwork& policy);

/// Brings the workers of a run back to one state after members were lost or have joined: all go back to the last update that every member
/// has completed, and a worker that joins gets that state from another one.  The update under way is then made again from the rollout that
/// each worker has.
///
/// Wrap the optimizer steps of an update in begin_update() and end_update(), call brief() after each, and recover() with every
/// MembershipChange that a collective call throws.
class Recovery {
 public:
  /// All but policy, which is a handle, must outlive this.  A worker whose collective is_joining() has no state until recover() returns.
  Recovery(Collective& collective, const EnvPlaces& places, PolicyNetwork policy, PpoLearner& learner, RunProgress& progress,
           UpdateReport& report);

  /// Before the first optimizer step: keeps a copy of the state if the collective survives a loss.
  void begin_update();
  /// The weights are those of a whole update.
  void end_update() { learning_ = false; }
  /// Tells the collective what workers that join have to know (JoinBriefing).
  void brief();
  /// Returns once all members hold the same state; progress and report are then those of it, and rank 0 has the run's files open.  Throws
  /// RunError if the members have no state in common.
  void recover(const MembershipChange& change);

 private:
  /// The whole update before the one under way.
  struct WholeUpdate {
    std::uint64_t update = 0, env_steps = 0;
    Checkpoint learner;  ///< weights and optimizer
    GuardCounts guards;
    int updates_without_step = 0;
  };
  /// How far the members are.
  struct Standing {
    std::vector<int> joining;                                        ///< ranks without a state
    int source = -1;                                                 ///< the first rank with one
    std::uint64_t last = std::numeric_limits<std::uint64_t>::max();  ///< update that all with a state have completed
  };

  bool agree_on_state();
  Standing gather_standing();
  bool check_equal_learners(const Standing& standing);
  void go_back();
  [[nodiscard]] Checkpoint copy_learner();
  void load_learner(const Checkpoint& learner, const std::string& where);
  [[nodiscard]] std::string encoded_state();
  void set_state(const std::string& bytes);

  Collective& collective_;
  const EnvPlaces& places_;
  PolicyNetwork policy_;
  PpoLearner& learner_;
  RunProgress& progress_;
  UpdateReport& report_;
  std::optional<WholeUpdate> last_whole_update_;
  bool learning_ = false;  ///< the weights are in the midst of an update
  bool joins_;             ///< has not got the state of the run yet
};

}  // namespace earshot
