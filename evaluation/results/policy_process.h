// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "envs/batch/batched_env.h"
#include "trainer/checkpoint/checkpoint_bytes.h"
#include "trainer/run/run_config.h"

namespace earshot {

/// What the process of a policy may take.
struct PolicyLimits {
  std::uint64_t memory_bytes = std::uint64_t{4} << 30;  ///< beyond what libtorch takes
  std::chrono::seconds cpu{86'400};                     ///< in all
  std::chrono::seconds answer{120};                     ///< wall time until it is loaded, and for each step of the batch
};

/// Runs a submitted policy in a child process.  The child has an empty working folder, writes no files, leaves no core and obeys
/// PolicyLimits; with Landlock it opens no files, so the private set and the results of others are out of its reach.  This process reads
/// from it only a config (at most 1 MB) and one action per environment.  Actions equal those of a run in one process.
class PolicyProcess {
 public:
  /// Starts the process and loads the policy.  Throws InputError that names the policy's file: it is refused, crashes, or meets a limit;
  /// RunError: the process cannot be started.
  PolicyProcess(const CheckpointBytes& policy, const PolicyLimits& limits);
  ~PolicyProcess();
  PolicyProcess(const PolicyProcess&) = delete;
  PolicyProcess& operator=(const PolicyProcess&) = delete;

  [[nodiscard]] const std::string& config_yaml() const;  ///< what the policy says its config is
  [[nodiscard]] const std::string& policy_hash() const;  ///< of its weights and architecture, 16 hexadecimal digits
  [[nodiscard]] bool can_open_files() const;             ///< the kernel has no Landlock, which would deny it

  /// An action for each environment of the batch, for its current observations.  The first call builds the network for the sensors of the
  /// batch.  Throws InputError as the constructor, and where the weights do not fit or give no finite numbers.
  void act(const BatchedEnv& env, ActionChoice choice, std::uint64_t seed, std::span<std::int32_t> actions);
  /// Notes which episodes have ended; called behind each step of the batch.
  void advance(const BatchedEnv& env);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The config of a policy that others made, without its folders: paths of its author are neither read nor written.  Throws InputError that
/// names `where`, the policy's file: its sound has channels of a file, or the config is wrong.
RunConfig config_of_policy(const std::string& yaml, const std::string& where);

/// Word by which a program is told to be the process of a policy, and what its main does then.
inline constexpr const char* kPolicyProcessWord = "policy-process";
int serve_policy(int argc, char** argv);

/// What travels: a request and its answer, or a refusal.
enum class PolicyMessage : std::uint64_t {
  hello = 0,    ///< answered by nothing where the process can open no files, else by "files"
  load = 1,     ///< the file's name, a zero, the file; answered by JSON {config, policy_hash}
  begin = 2,    ///< JSON {env, rows, argmax, seed, sensors [{name, type, shape}]}; answered by nothing
  step = 3,     ///< PolicyRow for each row, then the rows of each sensor; answered by an int32 for each row
  answer = 10,  ///< to the request before it
  refusal = 11  ///< one line
};
struct PolicyRow {
  std::uint32_t episode = 0, step = 0, has_ended = 0;
};

}  // namespace earshot
