// SPDX-License-Identifier: Apache-2.0
#include "trainer/checkpoint/run_state.h"

#include <gtest/gtest.h>

#include "sim/base/errors.h"
#include "tests/support/files/mutate.h"

namespace earshot {
namespace {

RunState example() {
  RunState state;
  state.learner.architecture = "gru";
  state.learner.update = 7;
  state.learner.env_steps = 12345;
  state.learner.weights = {{"a", torch::tensor({1.f, -0.f, 1e-42f})}, {"b", torch::zeros({2, 3})}};
  state.learner.optimizer = {{"a.step", torch::tensor(28, torch::kInt64)}, {"a.exp_avg", torch::tensor({0.1f, 0.2f, 0.3f})}};
  state.learner.episode_window = {1, 2, 3};
  state.learner.episode_window_fields = 3;
  state.guards = {
      .taken_steps = 1, .skipped_steps = 2, .loss_alarms = 3, .kl_alarms = 4, .failed_writes = 8, .lost_workers = 6, .joined_workers = 7};
  for (std::size_t i = 0; i < state.counters.values.size(); ++i) state.counters.values[i] = static_cast<double>(i) / 3;
  state.updates_without_step = 5;
  state.elapsed_s = 1.5;
  state.elapsed_before_s = 0.1;
  state.steps_before = 9000;
  return state;
}

TEST(RunState, ComesBackWithTheSameBits) {
  const RunState before = example(), after = decode_run_state(encode_run_state(before));
  EXPECT_EQ(hash_of_learner(after.learner), hash_of_learner(before.learner));
  EXPECT_EQ(after.learner.update, 7u);
  EXPECT_EQ(after.learner.env_steps, 12345u);
  EXPECT_EQ(after.learner.episode_window, before.learner.episode_window);
  EXPECT_EQ(after.counters.values, before.counters.values);
  EXPECT_EQ(after.guards.taken_steps, 1u);
  EXPECT_EQ(after.guards.skipped_steps, 2u);
  EXPECT_EQ(after.guards.loss_alarms, 3u);
  EXPECT_EQ(after.guards.kl_alarms, 4u);
  EXPECT_EQ(after.guards.lost_workers, 6u);
  EXPECT_EQ(after.guards.joined_workers, 7u);
  EXPECT_EQ(after.guards.failed_writes, 8u);
  EXPECT_EQ(after.updates_without_step, 5);
  EXPECT_EQ(after.elapsed_s, 1.5);
  EXPECT_EQ(after.elapsed_before_s, 0.1);
  EXPECT_EQ(after.steps_before, 9000u);
}

// One bit of a weight, of a moment or of a step is another hash; so is the sign of a zero.
TEST(RunState, TheHashSeesEveryBit) {
  const std::string hash = hash_of_learner(example().learner);
  Checkpoint other = example().learner;
  other.weights["a"][1] = 0.f;
  EXPECT_NE(hash_of_learner(other), hash);
  other = example().learner;
  other.optimizer["a.step"] = torch::tensor(29, torch::kInt64);
  EXPECT_NE(hash_of_learner(other), hash);
  other = example().learner;
  other.optimizer["a.exp_avg"][2] = 0.30000004f;
  EXPECT_NE(hash_of_learner(other), hash);
}

TEST(RunState, DamagedOnesAreRefused) {
  const std::string whole = encode_run_state(example());
  for (std::size_t length = 0; length < whole.size(); length += 7) EXPECT_THROW(decode_run_state(whole.substr(0, length)), RunError);
  std::string damaged = whole;
  damaged[whole.size() / 2] = static_cast<char>(damaged[whole.size() / 2] ^ 1);
  EXPECT_THROW(decode_run_state(damaged), RunError);
}

// clang 14 cannot compile the headers of libtorch, so that no fuzz target reads these.
TEST(RunState, RandomDamageIsRefusedOrRead) {
  const std::string whole = encode_run_state(example());
  int refused = 0;
  for (std::uint32_t number = 0; number < 3000; ++number) {
    try {
      static_cast<void>(decode_run_state(mutated(whole, number)));
    } catch (const RunError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 1500);  // more than half of the bytes are under the checksum of the checkpoint
}

TEST(JoinBriefing, ComesBackAndIsCompared) {
  const JoinBriefing briefing = decode_briefing(encode_briefing({{0, 2, 3}, 4, 17}), 3);
  EXPECT_EQ(briefing.places, (std::vector<int>{0, 2, 3}));
  EXPECT_EQ(briefing.started_workers, 4);
  EXPECT_EQ(briefing.update, 17u);
  for (const char* text : {"", "17", "17 4 0 2", "17 4 0 2 3 1", "17 4 0 2 4", "17 4 0 -1 3", "17 65 0 2 3", "17 4 0 2 x"})
    EXPECT_THROW(decode_briefing(text, 3), RunError) << text;
}

}  // namespace
}  // namespace earshot
