// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "envs/batch/batched_env.h"
#include "envs/config/batch_config.h"
#include "policy/policy_config.h"
#include "trainer/held_out/held_out_config.h"
#include "trainer/learner/guidance_config.h"
#include "trainer/learner/ppo_config.h"
#include "trainer/net/ring_config.h"
#include "trainer/rollout/rollout_config.h"

namespace earshot {

/// How far a training is: by steps alone, which gives the same bits on every machine, or by whatever of total_steps and max_minutes (over
/// all sittings) comes first.
enum class Schedule { steps, minutes };
/// Action selection of an evaluated policy: drawn from its distribution, or the likeliest.
enum class ActionChoice { sample, argmax };

/// One training run as its YAML file says it.  Sections: env, policy, ppo, guidance, held_out, network, data (train, eval, held_out); the
/// other keys are below.
struct RunConfig {
  std::string name = "run";
  std::string out = "runs/run";  ///< checkpoints, curves and results go here
  std::uint64_t seed = 0;
  int workers = 1;  ///< processes on this machine if no launcher says otherwise
  int envs_per_worker = 8;
  int rollout_steps = 150;
  bool overlap = false;                 ///< a worker steps its environments in two halves, one while the policy looks at the other
  std::uint64_t total_steps = 1000000;  ///< over all workers
  double max_minutes = 0;               ///< wall time of training; 0: no bound
  int checkpoint_every = 50;            ///< updates
  int keep = 3;                         ///< periodic checkpoints that stay, beside the best and the last
  std::string metrics_file = {};        ///< text file for Prometheus that each update replaces (metrics_file.h); empty: none
  int eval_envs = 8;                    ///< batch of the evaluation: fixed, because the results depend on it
  /// Policy file, checkpoint or run folder whose weights a new run starts from; empty: weights of policy.seed.
  std::string initial_policy = {};
  Schedule schedule = Schedule::steps;  ///< progress at which decays and guidance end
  ActionChoice eval_actions = ActionChoice::sample;
  EnvConfig env;
  PolicyConfig policy;
  PpoConfig ppo;
  GuidanceConfig guidance;
  HeldOutConfig held_out;
  NetworkConfig network;
  DataConfig train = training_data(), eval;
  DataConfig held_out_data;  ///< data.held_out: neither trained on nor those of the final evaluation
};

/// Sensors of the environments of a training: the sensors of the config, and the privileged ones that its losses read.
ObservationSpec training_sensors(const RunConfig& config);
/// Settings of the config for the collector of each worker.
RolloutConfig rollout_config(const RunConfig& config);

/// Reads the keys above over `config`, each by itself: load_run_config checks them together.  Throws InputError.
void read(ConfigReader& reader, RunConfig& config);
/// Reads and validates a run config.  Throws InputError naming the problem, the place and the remedy.
RunConfig load_run_config(const std::filesystem::path& path, const std::vector<std::string>& overrides);
RunConfig parse_run_config(std::string_view yaml, const std::string& where, const std::vector<std::string>& overrides);
/// Every key of a run with its value as YAML, defaults included: read again it gives the same run, whatever the defaults are by then.
/// Checkpoints hold this.
std::string config_text(const RunConfig& config);

/// Expands "PREFIX A..B REST" to one text per whole number in [A, B]; text without a range stays alone.  Throws InputError: over 100,000,
/// or B < A.
std::vector<std::string> expand_range(const std::string& text);
/// Expands ranges, and folders to the sound files in them by name order.
std::vector<std::string> expand_sounds(const std::vector<std::string>& sounds);

}  // namespace earshot
