// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/simulation/fault_schedule.h"

namespace earshot::simulation {

/// All that is drawn from one seed, but for the chance within the network.
struct Scenario {
  std::uint64_t seed = 0;
  int world_size = 3, updates = 4, minibatches = 1, rollout_steps = 4;
  std::size_t elements = 0;  ///< of a gradient
  double step_ms = 5, preempt_fraction = 0, progress_timeout_s = 8, timeout_s = 20;
  std::vector<int> slowness;  ///< by rank
  std::int64_t least_latency_us = 20, most_latency_us = 500;
  std::vector<Fault> faults;
  int adds_twice = -1;  ///< rank that adds its sum a second time to its weights, for a test of the checker
  /// Bound for one update of the slowest worker.
  [[nodiscard]] double update_s() const;
};
Scenario scenario_of(std::uint64_t seed);
std::string describe(const Scenario& scenario);

/// How a run ended, and what was wrong with it.
struct RunReport {
  std::vector<std::string> failures;  ///< broken promises
  std::vector<std::string> outcomes;  ///< of each process, "rank 2: finished"
  std::uint64_t messages = 0;
  int finished = 0, changes = 0, joins = 0;
  double longest_gap_s = 0;  ///< between two updates of the run
  bool must_go_on = false;   ///< only processes were killed, a minority, after the first update
};
/// Starts the workers of the scenario, whose code between the collective calls and libzmq is the product's own, and checks at each update
/// and at the end:
/// - all workers of one epoch have the same members;
/// - each update is the sum over the members of its epoch, bit for bit, once each, from the update before;
/// - who finishes has made all updates, with the same bits as all others who finish, and each checkpoint is one of these updates;
/// - no error speaks of a broken protocol, none lays the loss of others to a worker itself (exit code 1), and no process is left at the end
///   of the time;
/// - where the workers that were lost leave a majority each time, the others finish.
RunReport run_scenario(const Scenario& scenario);

}  // namespace earshot::simulation
