// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/optim/adam.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "policy/policy_network.h"
#include "trainer/checkpoint/find_checkpoint.h"

namespace earshot {

/// Everything a run needs to go on with the same bits, or an evaluation to act.
struct Checkpoint : CheckpointMetadata {
  std::map<std::string, torch::Tensor> weights;
  std::map<std::string, torch::Tensor> optimizer;  ///< Adam moments and step per parameter name; empty in exports
  std::vector<std::string> env_states;             ///< BatchedEnv::save_state per rank
  std::vector<torch::Tensor> hidden, not_done;     ///< per rank: recurrent state before the next step
  std::vector<torch::Tensor> oracle_acted;         ///< per rank: RolloutCollector::oracle_acted; empty in files of before
  std::vector<double> episode_window;              ///< EpisodeWindow::state of rank 0
  int episode_window_fields = 0;                   ///< numbers in each of its sums
  /// Which part of the environments each rank has: those that rank members[r] of a run with started_workers has at its start.  0, 1, ... of
  /// world_size as long as no worker was lost; empty in files of before.
  std::vector<int> members = {};
  int started_workers = 0;
  /// TorchScript file of a network that is not the built-in one; null: the built-in one.
  std::shared_ptr<const std::string> module = nullptr;
};

/// File: "EARSHOT\0", version, length, MessagePack body, XXH3 of the body.  Written atomically.  Tensors of float16 come back as float32.
/// Throws RunError if the disk is full.
void save_checkpoint(const Checkpoint& checkpoint, const std::filesystem::path& path);
/// The bytes of such a file; `where` is named by errors.
std::string encode_checkpoint(const Checkpoint& checkpoint, const std::string& where);
/// Throws InputError, one line: missing, not a checkpoint, other version, truncated, hash mismatch, malformed body.
Checkpoint load_checkpoint(const std::filesystem::path& path);
/// The same for bytes that are in memory; `where` is what errors name.  Nothing is executed and no count is believed beyond the bytes that
/// are there.
Checkpoint decode_checkpoint(std::string_view bytes, const std::string& where);

/// The network of a checkpoint with its weights: the built-in one, or that of its module.  spec: what it sees; config: of its policy.
/// Throws InputError if they do not fit.
PolicyNetwork network_of(const Checkpoint& checkpoint, const ObservationSpec& spec, const PolicyConfig& config, const std::string& where);

/// By name: parameters and buffers of the policy, as copies.
std::map<std::string, torch::Tensor> weights_of(const PolicyNetwork& policy);
/// XXH3 of their bits, by name order, going on from `start`.
std::uint64_t hash_of(const std::map<std::string, torch::Tensor>& weights, std::uint64_t start = 0);
/// Throws InputError naming both architectures if they differ, or what does not fit or is not finite; then nothing has changed.
void load_weights(const PolicyNetwork& policy, const Checkpoint& checkpoint, const std::string& where);
/// Adam's state by parameter name and ".step", ".exp_avg" or ".exp_avg_sq"; parameters that were never stepped are left out.
std::map<std::string, torch::Tensor> optimizer_state_of(const PolicyNetwork& policy, torch::optim::Adam& optimizer);
/// Puts it back: further steps have the bits of the unbroken run.  Without any state in the checkpoint Adam starts anew.  Throws InputError
/// if it does not fit the policy; then nothing has changed.
void load_optimizer_state(const PolicyNetwork& policy, torch::optim::Adam& optimizer, const Checkpoint& checkpoint);

/// Architecture, weights_of() and optimizer_state_of(); the other fields have their defaults.
Checkpoint learner_state_of(const PolicyNetwork& policy, torch::optim::Adam& optimizer);
/// load_weights(), then load_optimizer_state().
void load_learner_state(const PolicyNetwork& policy, torch::optim::Adam& optimizer, const Checkpoint& learner, const std::string& where);

}  // namespace earshot
