// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "envs/baselines/baseline_observation.h"
#include "envs/batch/batched_env.h"
#include "envs/sensors/sensor.h"
#include "sim/base/random.h"

namespace earshot {

/// Agents without learning.
enum class Baseline {
  random,              ///< uniform over the four actions
  random_oracle_stop,  ///< uniform over forward, left and right; stops where the oracle does: the success of wandering alone
  greedy,              ///< by ear and depth, without a map (baseline_greedy.h)
  classical,           ///< direction by ear, map by depth, frontiers (baseline_classical.h)
  oracle,              ///< follows the geodesic
};
std::optional<Baseline> baseline_by_name(std::string_view name);
std::string_view baseline_name(Baseline baseline);
/// Kinds of sensors that it reads; empty of those that go by what the simulator knows (reads_simulator) or by chance.
std::vector<SensorKind> sensors_of(Baseline baseline);
/// Whether it acts by the goal and the map of the simulator.
bool reads_simulator(Baseline baseline);
/// "random random_oracle_stop greedy classical oracle": for messages.
std::string baseline_names();

/// State of a baseline for one row between steps.
class BaselineMemory {
 public:
  virtual ~BaselineMemory() = default;
  /// Forgets all: an episode begins.
  virtual void begin() = 0;
  /// The action that follows on `observation`.  random: numbers of this step.  Called once a step.
  virtual Action act(const BaselineObservation& observation, const RandomStream& random) = 0;
};

/// One baseline for all rows of a batch, with memory per row, which an episode begins empty: a row whose episode and step are not those
/// that follow on the last call is taken to have begun anew.  Actions are a function of (seed, first_env, what the env was asked to do),
/// not of threads nor of how a batch is split.  Used by one thread at a time.
class BaselineAgent {
 public:
  /// For envs with this config, as many rows as they have; first_env: of the first row, for its random numbers.  Throws InputError if the
  /// config lacks a sensor without which the baseline cannot act.
  BaselineAgent(Baseline baseline, const EnvConfig& config, int num_rows, std::uint64_t seed, int first_env = 0);

  /// Writes one action per row, [env.num_rows()]: `stop` where the row is not active.  Once before each step of `env`.
  void act(const BatchedEnv& env, std::span<std::int32_t> actions);

 private:
  struct Row {
    std::unique_ptr<BaselineMemory> memory = nullptr;  ///< null: of a baseline that keeps nothing
    int episode = -1, step = -1;                       ///< of the last call
  };

  Baseline baseline_;
  std::uint64_t seed_;
  int first_env_;
  std::vector<Row> rows_;
};

}  // namespace earshot
