// SPDX-License-Identifier: Apache-2.0
#include "trainer/run/policy_file.h"

#include <gtest/gtest.h>

#include "policy/actor_critic.h"
#include "sim/base/errors.h"
#include "tests/support/workers/worker_processes.h"
#include "trainer/run/initial_policy.h"

namespace earshot {
namespace {

RunConfig small_config() {
  return parse_run_config(
      "name: small\nenv: {observation: {depth: false}}\npolicy: {hidden_size: 8, audio_features: 8, conv_channels: 2, seed: 3}\n", "test",
      {});
}

/// As a training leaves it behind.
Checkpoint trained(const RunConfig& config) {
  const ActorCritic policy(config.env.observation, config.policy);
  Checkpoint checkpoint;
  checkpoint.config_yaml = config_text(config);
  checkpoint.architecture = policy->architecture();
  checkpoint.env_steps = 1234;
  checkpoint.weights = weights_of(policy);
  checkpoint.optimizer["step"] = torch::tensor(7, torch::kInt64);
  checkpoint.env_states = {"state"};
  checkpoint.hidden = checkpoint.not_done = {torch::ones({2})};
  return checkpoint;
}

TEST(PolicyFile, HoldsWeightsAndOriginAlone) {
  const Checkpoint whole = trained(small_config()), policy = policy_of(whole, WeightStorage::float32);
  const PrivateTestFolder folder;
  save_checkpoint(whole, folder.path() / "whole.ckpt");
  save_checkpoint(policy, folder.path() / "a.policy");
  EXPECT_FALSE(load_checkpoint_metadata(folder.path() / "whole.ckpt").is_policy);
  EXPECT_TRUE(load_checkpoint_metadata(folder.path() / "a.policy").is_policy);
  EXPECT_EQ(policy.env_steps, 1234u);
  EXPECT_EQ(policy.config_yaml, whole.config_yaml);
  EXPECT_TRUE(policy.optimizer.empty() && policy.hidden.empty() && policy.not_done.empty());
  EXPECT_EQ(hash_of(policy.weights), hash_of(whole.weights));
}

TEST(PolicyFile, HalvesAreWithinTheirRoundingAndComeBackAsFloats) {
  const PrivateTestFolder folder;
  const Checkpoint whole = trained(small_config());
  save_checkpoint(policy_of(whole, WeightStorage::float16), folder.path() / "half.policy");
  const Checkpoint half = load_checkpoint(folder.path() / "half.policy");
  bool differs = false;
  for (const auto& [name, tensor] : whole.weights) {
    ASSERT_EQ(half.weights.at(name).scalar_type(), torch::kFloat32);
    const torch::Tensor error = (half.weights.at(name) - tensor).abs();
    // Round to nearest: half a unit in the last of eleven places; below 2^-14 the places are 2^-24 apart.
    EXPECT_TRUE((error <= tensor.abs() * 0x1p-11 + 0x1p-25).all().item<bool>()) << name;
    differs = differs || error.max().item<float>() > 0;
  }
  EXPECT_TRUE(differs);
  save_checkpoint(policy_of(half, WeightStorage::float16), folder.path() / "again.policy");
  EXPECT_EQ(hash_of(load_checkpoint(folder.path() / "again.policy").weights), hash_of(half.weights)) << "rounded once, it stays";
}

TEST(PolicyFile, WhatHalvesCannotHoldIsRefused) {
  Checkpoint whole = trained(small_config());
  whole.weights.begin()->second.flatten()[0] = 70000;
  EXPECT_THROW(policy_of(whole, WeightStorage::float16), InputError);
  EXPECT_NO_THROW(policy_of(whole, WeightStorage::float32));
}

TEST(PolicyFile, ARunStartsFromItsWeights) {
  const PrivateTestFolder folder;
  RunConfig config = small_config();
  const Checkpoint whole = trained(config);
  config.initial_policy = (folder.path() / "a.policy").string();
  save_checkpoint(policy_of(whole, WeightStorage::float32), config.initial_policy);
  config.policy.seed = 99;
  ActorCritic policy(config.env.observation, config.policy);
  ASSERT_NE(hash_of(weights_of(policy)), hash_of(whole.weights));
  load_initial_policy(config, policy);
  EXPECT_EQ(hash_of(weights_of(policy)), hash_of(whole.weights));

  config.policy.hidden_size = 9;
  EXPECT_THROW(check_policy(config, {}), InputError);
}

}  // namespace
}  // namespace earshot
