// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/checkpoint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstring>

#include "policy/actor_critic.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/workers/worker_processes.h"

namespace earshot {
namespace {

ActorCritic small_policy(int hidden_size = 8, std::uint64_t seed = 1) {
  ObservationSpec spec;
  spec.depth = false;
  PolicyConfig config;
  config.hidden_size = hidden_size;
  config.audio_features = 8;
  config.conv_channels = 2;
  config.seed = seed;
  return ActorCritic(spec, config);
}

/// A checkpoint of a few kilobytes with one tensor of every type.
Checkpoint sample() {
  Checkpoint checkpoint;
  checkpoint.config_yaml = "name: test\n";
  checkpoint.architecture = "an architecture";
  checkpoint.update = 12;
  checkpoint.env_steps = 3456789012345;
  checkpoint.seed = 0xFFFFFFFFFFFFFFFFull;
  checkpoint.world_size = 2;
  checkpoint.weights["float"] = torch::arange(24, torch::kFloat32).reshape({2, 3, 4}) / 7;
  checkpoint.weights["empty"] = torch::empty({0, 3});
  checkpoint.optimizer["step"] = torch::tensor(1234567890123, torch::kInt64);  // no dimensions
  checkpoint.optimizer["double"] = torch::tensor({1.0 / 3, -0.0, 1e300}, torch::kFloat64);
  checkpoint.optimizer["int"] = torch::tensor({-1, 2}, torch::kInt32);
  checkpoint.optimizer["byte"] = torch::tensor({0, 255}, torch::kUInt8);
  checkpoint.optimizer["bool"] = torch::tensor({true, false});
  checkpoint.env_states = {std::string("\0env\xFF", 5), std::string(200, 'e')};
  checkpoint.hidden = {torch::ones({2, 8}), torch::zeros({2, 8})};
  checkpoint.not_done = {torch::ones({2}), torch::zeros({2})};
  checkpoint.engine = "0123456789abcdef";
  checkpoint.engine_commit = "abc-dirty";
  checkpoint.mean_reward = -1.25;
  checkpoint.episode_window = {1, 0, 1.0 / 3};
  return checkpoint;
}

bool same_bits(const torch::Tensor& a, const torch::Tensor& b) {
  return a.sizes() == b.sizes() && a.scalar_type() == b.scalar_type() &&
         (a.numel() == 0 || std::memcmp(a.contiguous().data_ptr(), b.contiguous().data_ptr(), a.nbytes()) == 0);
}

std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no InputError";
}

class CheckpointFile : public testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path path() const { return folder_.path() / "last.ckpt"; }
  static std::string load_error(const std::string& bytes) {
    return error_of([&] { decode_checkpoint(bytes, "a.ckpt"); });
  }
  /// The bytes with a hash that fits whatever the body is now.
  static std::string with_good_hash(std::string bytes) {
    const std::uint64_t length = bytes.size() - 28, hash = hash64(std::string_view(bytes).substr(20, length));
    std::memcpy(bytes.data() + 12, &length, 8);
    std::memcpy(bytes.data() + bytes.size() - 8, &hash, 8);
    return bytes;
  }

  PrivateTestFolder folder_;
};

TEST_F(CheckpointFile, EvaluationsOfTheRunComeBackAndOthersHaveNone) {
  Checkpoint saved = sample();
  save_checkpoint(saved, path());
  EXPECT_FALSE(load_checkpoint(path()).held_out.has_value());
  const HeldOutState state{
      .set = "abc", .evaluations = 3, .last_update = 12, .best_update = 8, .best = {{0.25, 0.125, 1.0 / 3}, {0.1, 0, 0.2}}};
  saved.held_out = state;
  save_checkpoint(saved, path());
  EXPECT_EQ(load_checkpoint(path()).held_out, state);
  EXPECT_EQ(load_checkpoint_metadata(path()).held_out, state);
  std::string bytes = read_file(path());
  bytes.replace(bytes.find("abc 3 12 8"), 10, "abc 3 8 12");  // the best is none of those that were
  EXPECT_THAT(load_error(with_good_hash(bytes)), testing::HasSubstr("'held_out' is not the state of evaluations"));
}

TEST_F(CheckpointFile, ComesBackBitForBit) {
  const Checkpoint saved = sample();
  save_checkpoint(saved, path());
  const Checkpoint loaded = load_checkpoint(path());
  EXPECT_EQ(loaded.config_yaml, saved.config_yaml);
  EXPECT_EQ(loaded.architecture, saved.architecture);
  EXPECT_EQ(loaded.update, saved.update);
  EXPECT_EQ(loaded.env_steps, saved.env_steps);
  EXPECT_EQ(loaded.seed, saved.seed);
  EXPECT_EQ(loaded.world_size, saved.world_size);
  EXPECT_EQ(loaded.engine, saved.engine);
  EXPECT_EQ(loaded.engine_commit, saved.engine_commit);
  EXPECT_EQ(loaded.mean_reward, saved.mean_reward);
  EXPECT_EQ(loaded.episode_window, saved.episode_window);
  EXPECT_EQ(loaded.env_states, saved.env_states);
  const auto expect_same = [](const auto& a, const auto& b) {
    ASSERT_EQ(a.size(), b.size());
    for (const auto& [name, tensor] : a) EXPECT_TRUE(same_bits(tensor, b.at(name))) << name;
  };
  expect_same(saved.weights, loaded.weights);
  expect_same(saved.optimizer, loaded.optimizer);
  for (std::size_t i = 0; i < 2; ++i)
    EXPECT_TRUE(same_bits(saved.hidden[i], loaded.hidden[i]) && same_bits(saved.not_done[i], loaded.not_done[i]));
  EXPECT_EQ(loaded.hidden.size(), 2u);
}

TEST_F(CheckpointFile, SameContentGivesTheSameBytes) {
  save_checkpoint(sample(), path());
  const std::string first = read_file(path());
  save_checkpoint(load_checkpoint(path()), path());
  EXPECT_EQ(read_file(path()), first);
  EXPECT_EQ(first.substr(0, 8), std::string("EARSHOT\0", 8));
}

TEST_F(CheckpointFile, WhatIsNoCheckpointIsSaid) {
  EXPECT_NE(error_of([&] { load_checkpoint(folder_.path() / "none.ckpt"); }).find("none.ckpt"), std::string::npos);
  EXPECT_NE(load_error("").find("is not an Earshot checkpoint"), std::string::npos);
  EXPECT_NE(load_error(std::string(1000, 'x')).find("is not an Earshot checkpoint"), std::string::npos);
  save_checkpoint(sample(), path());
  std::string bytes = read_file(path());
  bytes[8] = 9;
  EXPECT_NE(load_error(bytes).find("version 9"), std::string::npos);
  bytes[8] = 1;
  EXPECT_NE(load_error(bytes).find("is a checkpoint of version 1, but earshot "), std::string::npos);
  bytes[8] = 2;
  EXPECT_NE(load_error(bytes.substr(0, bytes.size() - 1)).find("has the wrong size"), std::string::npos);
  EXPECT_NE(load_error(bytes + "x").find("has the wrong size"), std::string::npos);
  bytes[100] ^= 1;
  EXPECT_NE(load_error(bytes).find("hash"), std::string::npos);
  write_file_atomically(path(), bytes);
  EXPECT_NE(error_of([&] { load_checkpoint(path()); }).find(path().string()), std::string::npos);
}

TEST_F(CheckpointFile, EveryTruncationIsAnInputError) {
  save_checkpoint(sample(), path());
  const std::string bytes = read_file(path());
  for (std::size_t length = 0; length < bytes.size(); length += length < 64 ? 1 : 64) {
    EXPECT_NE(load_error(bytes.substr(0, length)), "no InputError") << length;
    // The same with length and hash forged to fit: then the body itself must be found short.
    if (length < 28) continue;
    EXPECT_NE(load_error(with_good_hash(bytes.substr(0, length))), "no InputError") << length;
  }
}

TEST_F(CheckpointFile, EveryFlippedByteIsAnInputError) {
  save_checkpoint(sample(), path());
  const std::string good = read_file(path());
  for (std::uint32_t trial = 0; trial < 2000; ++trial) {
    const RandomStream random(11, Purpose::test, trial);
    std::string bytes = good;
    bytes[random.below(static_cast<std::uint32_t>(bytes.size()), 0)] ^= static_cast<char>(1 + random.below(255, 1));
    ASSERT_NE(load_error(bytes), "no InputError") << trial;
  }
}

// A forger can make the hash fit.  Then the decoder stands alone: it refuses, or the values are others, but nothing else happens.
TEST_F(CheckpointFile, ForgedBodiesAreInputErrorsOrCheckpoints) {
  save_checkpoint(sample(), path());
  const std::string good = read_file(path());
  int refused = 0;
  for (std::uint32_t trial = 0; trial < 6000; ++trial) {
    const RandomStream random(13, Purpose::test, trial);
    std::string bytes = good;
    for (std::uint32_t flip = 0; flip <= random.below(3, 100); ++flip)
      bytes[20 + random.below(static_cast<std::uint32_t>(bytes.size() - 28), 2 * flip)] ^=
          static_cast<char>(1 + random.below(255, 2 * flip + 1));
    try {
      decode_checkpoint(with_good_hash(bytes), "a.ckpt");
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST_F(CheckpointFile, FullDiskKeepsTheOldOneAndLeavesNoTemporary) {
  save_checkpoint(sample(), path());
  const std::string old = read_file(path());
  const pid_t pid = WorkerProcesses::start(0, [&](int) {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{10000, 10000};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    Checkpoint large = sample();
    large.env_states[0] = std::string(20000, 'x');
    try {
      save_checkpoint(large, path());
    } catch (const RunError&) {
      return true;
    }
    return false;
  });
  int status = -1;
  ::waitpid(pid, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(read_file(path()), old);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
}

TEST(CheckpointWeights, MoveBetweenPolicies) {
  ActorCritic from = small_policy(8, 1), to = small_policy(8, 2);
  Checkpoint checkpoint;
  checkpoint.architecture = from->architecture();
  checkpoint.weights = weights_of(from);
  std::int64_t count = 0;
  for (const auto& [name, tensor] : checkpoint.weights) count += tensor.numel();
  EXPECT_EQ(count, from->num_parameters());
  load_weights(to, checkpoint, "test.ckpt");
  const auto loaded = weights_of(to);
  for (const auto& [name, tensor] : checkpoint.weights) EXPECT_TRUE(same_bits(tensor, loaded.at(name))) << name;
  // Copies, not views: what training does next must not change the checkpoint.
  {
    const torch::NoGradGuard no_grad;
    for (auto& parameter : from->parameters()) parameter.zero_();
  }
  EXPECT_TRUE(same_bits(checkpoint.weights.begin()->second, loaded.begin()->second));
}

TEST(CheckpointWeights, AnotherArchitectureIsAnInputErrorThatNamesBoth) {
  ActorCritic small = small_policy(8), large = small_policy(16);
  Checkpoint checkpoint;
  checkpoint.architecture = large->architecture();
  checkpoint.weights = weights_of(large);
  const auto before = weights_of(small);
  const std::string error = error_of([&] { load_weights(small, checkpoint, "test.ckpt"); });
  EXPECT_NE(error.find("test.ckpt"), std::string::npos);
  EXPECT_NE(error.find(large->architecture()), std::string::npos);
  EXPECT_NE(error.find(small->architecture()), std::string::npos);

  checkpoint.architecture = small->architecture();  // lies about its shapes
  EXPECT_NE(error_of([&] { load_weights(small, checkpoint, "test.ckpt"); }).find("shape"), std::string::npos);
  checkpoint.weights = weights_of(small);
  const std::string name = checkpoint.weights.rbegin()->first;
  checkpoint.weights["unknown"] = torch::zeros({1});
  EXPECT_NE(error_of([&] { load_weights(small, checkpoint, "test.ckpt"); }).find("unknown"), std::string::npos);
  checkpoint.weights.erase("unknown");
  checkpoint.weights[name].view(-1)[0] = NAN;
  EXPECT_NE(error_of([&] { load_weights(small, checkpoint, "test.ckpt"); }).find("non-finite"), std::string::npos);
  checkpoint.weights.erase(name);
  EXPECT_NE(error_of([&] { load_weights(small, checkpoint, "test.ckpt"); }).find(name), std::string::npos);
  for (const auto& [key, tensor] : weights_of(small)) EXPECT_TRUE(same_bits(tensor, before.at(key))) << key;  // refused as a whole
}

/// One step on gradients that are a function of the step, like any training.
void train_step(ActorCritic& policy, torch::optim::Adam& optimizer, int step) {
  std::int64_t index = 0;
  for (auto& parameter : policy->parameters()) {
    parameter.mutable_grad() =
        torch::sin(torch::arange(parameter.numel(), torch::kFloat32) + static_cast<double>(step + 10 * index++)).reshape(parameter.sizes());
  }
  optimizer.step();
}

TEST(CheckpointOptimizer, ResumedAdamGoesOnWithTheSameBits) {
  const PrivateTestFolder folder;
  const auto options = torch::optim::AdamOptions(1e-2).eps(1e-5);
  ActorCritic unbroken = small_policy(8, 1);
  torch::optim::Adam optimizer(unbroken->parameters(), options);
  for (int step = 0; step < 5; ++step) train_step(unbroken, optimizer, step);
  Checkpoint checkpoint;
  checkpoint.architecture = unbroken->architecture();
  checkpoint.weights = weights_of(unbroken);
  checkpoint.optimizer = optimizer_state_of(unbroken, optimizer);
  EXPECT_EQ(checkpoint.optimizer.size(), 3 * unbroken->parameters().size());
  save_checkpoint(checkpoint, folder.path() / "a.ckpt");
  for (int step = 5; step < 10; ++step) train_step(unbroken, optimizer, step);

  ActorCritic resumed = small_policy(8, 2);
  torch::optim::Adam second(resumed->parameters(), options);
  train_step(resumed, second, 99);  // what was there before must not shine through
  const Checkpoint loaded = load_checkpoint(folder.path() / "a.ckpt");
  load_weights(resumed, loaded, "a.ckpt");
  ActorCritic forgetful = small_policy(8, 2);
  load_weights(forgetful, loaded, "a.ckpt");
  torch::optim::Adam fresh(forgetful->parameters(), options);
  load_optimizer_state(resumed, second, loaded);
  for (int step = 5; step < 10; ++step) {
    train_step(resumed, second, step);
    train_step(forgetful, fresh, step);
  }
  const auto expected = weights_of(unbroken), actual = weights_of(resumed), without = weights_of(forgetful);
  for (const auto& [name, tensor] : expected) {
    EXPECT_TRUE(same_bits(tensor, actual.at(name))) << name;
    EXPECT_FALSE(same_bits(tensor, without.at(name))) << name;  // the test would see a lost state
  }
}

TEST(CheckpointOptimizer, WrongStateIsAnInputErrorAndChangesNothing) {
  ActorCritic policy = small_policy();
  torch::optim::Adam optimizer(policy->parameters(), torch::optim::AdamOptions(1e-2));
  train_step(policy, optimizer, 0);
  Checkpoint good;
  good.optimizer = optimizer_state_of(policy, optimizer);
  const std::string name = policy->named_parameters()[0].key();
  const auto expect_refused = [&](auto change, const std::string& text) {
    Checkpoint bad = good;
    change(bad.optimizer);
    EXPECT_NE(error_of([&] { load_optimizer_state(policy, optimizer, bad); }).find(text), std::string::npos) << text;
  };
  using State = std::map<std::string, torch::Tensor>;
  expect_refused([&](State& state) { state.erase(name + ".exp_avg"); }, "incomplete");
  expect_refused([&](State& state) { state[name + ".exp_avg"] = torch::zeros({1, 2, 3}); }, "shape");
  expect_refused([&](State& state) { state[name + ".exp_avg_sq"] = torch::full_like(state[name + ".exp_avg_sq"], NAN); }, "finite");
  expect_refused([&](State& state) { state[name + ".step"] = torch::tensor(-1, torch::kInt64); }, "is not a whole number");
  expect_refused([&](State& state) { state["unknown.step"] = torch::tensor(1, torch::kInt64); }, "does not have");
  const auto after = optimizer_state_of(policy, optimizer);
  for (const auto& [key, tensor] : good.optimizer) EXPECT_TRUE(same_bits(tensor, after.at(key))) << key;
  load_optimizer_state(policy, optimizer, Checkpoint{});  // an export has no optimizer state: Adam starts anew
  EXPECT_TRUE(optimizer_state_of(policy, optimizer).empty());
}

}  // namespace
}  // namespace earshot
