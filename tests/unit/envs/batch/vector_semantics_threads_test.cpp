// SPDX-License-Identifier: Apache-2.0
// A batch on several threads and in the background: what it shows, and what stays in one env.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <new>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>

#include "sim/base/errors.h"
#include "tests/support/envs/vector_semantics.h"
#include "tests/support/wait_until.h"

namespace earshot {
namespace {

// Each env shows the same, whatever the threads, and however sending and waiting are interleaved.
TEST_F(VectorSemantics, SendingGivesTheBitsOfLockstep) {
  constexpr int kEnvs = 6, kEnvSteps = 24;
  BatchedEnv lockstep = make(kEnvs, config_);
  lockstep.reset();
  std::vector<std::vector<std::vector<std::byte>>> expected(kEnvs);
  for (int i = 0; i < kEnvSteps; ++i) {
    step(lockstep, i);
    for (int row = 0; row < kEnvs; ++row) expected[static_cast<std::size_t>(row)].push_back(shown(lockstep, row));
  }
  for (const int threads : {1, 2, 3, 8})
    for (const RecvOrder order : {RecvOrder::as_ready, RecvOrder::as_sent}) {
      EnvConfig config = config_;
      config.threads = threads;
      BatchedEnv env = make(kEnvs, config);
      env.reset();
      std::vector<int> done(kEnvs, 0);
      std::vector<std::int32_t> ready{0, 1, 2, 3, 4, 5};
      std::size_t ends = 0, under_way = 0;
      std::vector<std::vector<std::int32_t>> handed_back;
      while (!ready.empty() || under_way > 0) {
        std::vector<std::int32_t> send, actions;
        for (const std::int32_t row : ready)
          if (done[static_cast<std::size_t>(row)] < kEnvSteps) {
            send.push_back(row);
            actions.push_back(test_action(row, done[static_cast<std::size_t>(row)]));
          }
        env.send(send, actions);
        under_way += send.size();
        ready.clear();
        if (under_way == 0) break;
        const auto got = env.recv(std::min(2, static_cast<int>(under_way)), order);
        ready.assign(got.begin(), got.end());
        handed_back.push_back(ready);
        under_way -= got.size();
        ends += env.finished().size();
        for (const std::int32_t row : ready) {
          const auto i = static_cast<std::size_t>(row);
          ASSERT_EQ(shown(env, row), expected[i][static_cast<std::size_t>(done[i]++)]) << row;
        }
      }
      EXPECT_GT(ends, 4u);
      if (order == RecvOrder::as_ready) continue;
      // Two at a time in the order of sending: 0 1, 2 3, 4 5, 0 1, ...
      for (std::size_t i = 0; i < handed_back.size(); ++i) EXPECT_EQ(handed_back[i].front(), static_cast<std::int32_t>(2 * (i % 3))) << i;
    }
}

// Sizes at and around powers of two, which rings of environments could get wrong.
TEST_F(VectorSemantics, BatchesOfAnySizeShowTheSameEnvs) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = config.observation.depth = false;
  config.observation.collision = config.observation.gps_compass = true;
  BatchedEnv largest = make(1024, config);
  largest.reset();
  std::vector<std::vector<std::byte>> expected;
  for (int i = 0; i < 20; ++i) step(largest, i);
  for (int row = 0; row < 1024; ++row) expected.push_back(shown(largest, row));
  config.threads = 3;
  for (const int envs : {1, 2, 255, 256, 257, 1024}) {
    BatchedEnv env = make(envs, config);
    env.reset();
    std::vector<std::int32_t> all(static_cast<std::size_t>(envs)), actions(all.size());
    for (int i = 0; i < 20; ++i) {
      for (int row = 0; row < envs; ++row) {
        all[static_cast<std::size_t>(row)] = row;
        actions[static_cast<std::size_t>(row)] = test_action(row, i);
      }
      if (i % 2 == 0) {
        env.step(actions);
        continue;
      }
      env.send(all, actions);
      std::set<std::int32_t> got;
      while (got.size() < all.size()) {
        const auto received = env.recv(std::max(1, static_cast<int>(all.size() - got.size()) / 2));
        got.insert(received.begin(), received.end());
      }
    }
    for (int row = 0; row < envs; ++row) ASSERT_EQ(shown(env, row), expected[static_cast<std::size_t>(row)]) << envs << " " << row;
  }
}

/// Throws, or waits, in one stage of one env, once.
struct ThrowOnce {
  std::atomic<int> armed{0};  // 1: runtime_error, 2: bad_alloc, 3: no exception class at all, 4: logic_error
  Fault kind = Fault::pose;
  void operator()(const StageOutput& output) {
    if (output.kind != kind || output.env != 1) return;
    switch (armed.exchange(0)) {
      case 1:
        throw std::runtime_error("the roof fell in");
      case 2:
        throw std::bad_alloc();
      case 3:
        throw 7;
      case 4:
        throw std::logic_error("a bug");
      default:
        break;
    }
  }
};

// Any exception in any stage, reset included, ends one env's episode; the other envs show what they show without it.
TEST_F(VectorSemantics, AnyExceptionIsContainedInItsEnv) {
  config_.threads = 2;
  BatchedEnv plain = make(3, config_);
  BatchedEnv env = make(3, config_);
  ThrowOnce thrower;
  env.set_stage_hook([&](const StageOutput& output, std::span<float>) { thrower(output); });
  plain.reset();
  env.reset();
  std::uint64_t faults = 0;
  int index = 0;
  for (const Fault kind : {Fault::pose, Fault::distance, Fault::rir, Fault::sound, Fault::depth, Fault::spectrogram})
    for (const int variant : {1, 2, 3, 4}) {
      thrower.kind = kind;
      thrower.armed = variant;
      for (int tries = 0; thrower.armed != 0 && tries < 100; ++tries, ++index) {
        std::vector<std::int32_t> actions{test_action(0, index), 1, test_action(2, index)};
        if (tries > 0) actions[1] = test_action(1, index);  // stages without news are skipped: turn, or begin another episode
        plain.step(actions);
        env.step(actions);
        for (const int row : {0, 2}) ASSERT_EQ(shown(env, row), shown(plain, row)) << index;
      }
      ASSERT_EQ(thrower.armed, 0) << static_cast<int>(kind);
      ++faults;
      EXPECT_EQ(env.quarantine_counters().total(), faults);
    }
}

// A lasting lack of memory is not a fault of an episode: the batch ends with one line instead of quarantining forever.
TEST_F(VectorSemantics, MemoryThatIsGoneForGoodEndsTheBatch) {
  config_.threads = 2;
  BatchedEnv env = make(3, config_);
  std::atomic<bool> is_armed{false};
  env.set_stage_hook([&](const StageOutput&, std::span<float>) {
    if (is_armed) throw std::bad_alloc();
  });
  env.reset();
  is_armed = true;
  std::string reason = "none";
  for (int index = 0; index < 200 && reason == "none"; ++index) try {
      env.step(std::vector<std::int32_t>{test_action(0, index), test_action(1, index), test_action(2, index)});
    } catch (const RunError& error) {
      reason = error.what();
    }
  EXPECT_NE(reason.find("out of memory"), std::string::npos) << reason;
}

// The stage hangs while the first episode begins: the env takes no part in the steps that follow, nor in what is counted, and comes back.
TEST_F(VectorSemantics, AStalledStartLeavesTheBatchUntilItReturns) {
  config_.threads = 2;
  BatchedEnv plain = make(1, config_);
  const auto start = std::chrono::steady_clock::now();
  plain.reset();
  config_.stage_limit_s = std::max(0.5, 8 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  BatchedEnv env = make(2, config_);
  std::atomic<bool> armed{true}, released{false};
  env.set_stage_hook([&](const StageOutput& output, std::span<float>) {
    if (output.env != 1 || output.kind != Fault::rir || !armed.exchange(false)) return;
    EXPECT_TRUE(wait_for_flag(released));
  });
  env.reset();
  EXPECT_FALSE(armed);
  EXPECT_TRUE(env.active()[0] && !env.active()[1]);
  EXPECT_EQ(env.quarantine_counters().of(Fault::stall), 1u);
  EXPECT_THROW(env.begin(1, 0, 0), std::logic_error);
  for (int i = 0; i < 4; ++i) {
    plain.step(std::vector<std::int32_t>{1});
    env.step(std::vector<std::int32_t>{1, 1});
    EXPECT_EQ(shown(env, 0), shown(plain, 0)) << i;
    EXPECT_FALSE(env.active()[1]);
    EXPECT_EQ(env.counters().effects.poses, plain.counters().effects.poses) << i;
    EXPECT_EQ(env.counters().cached_responses, plain.counters().cached_responses) << i;
  }
  const auto step_until_back = [&] {
    released = true;
    for (int tries = 0; tries < 2000 && !env.active()[1]; ++tries) {
      env.step(std::vector<std::int32_t>{1, 1});
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_TRUE(env.active()[1] && env.quarantined()[1] && !env.acted()[1]);
    EXPECT_TRUE(buffers_are_finite(env));
  };
  step_until_back();
  released = false;
  armed = true;
  const auto fault = env.begin(1, 0, 0);
  ASSERT_TRUE(fault);
  EXPECT_EQ(fault->fault, Fault::stall);
  EXPECT_FALSE(env.active()[1]);
  step_until_back();
}

// A stage that does not come back is given up after the limit; its env is idle until it does, and the others go on with their bits.
TEST_F(VectorSemantics, AStalledStageLeavesTheBatchUntilItReturns) {
  config_.threads = 2;
  BatchedEnv plain = make(3, config_);
  // Far longer than any stage takes on this machine, in this build: the first reset loads the scenes too.
  const auto start = std::chrono::steady_clock::now();
  plain.reset();
  config_.stage_limit_s = std::max(0.5, 4 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  BatchedEnv env = make(3, config_);
  std::atomic<bool> armed{false}, released{false}, stuck{false};
  env.set_stage_hook([&](const StageOutput& output, std::span<float>) {
    if (output.env != 1 || output.kind != Fault::pose || !armed.exchange(false)) return;
    stuck = true;
    EXPECT_TRUE(wait_for_flag(released));
    stuck = false;
  });
  env.reset();
  int index = 0;
  const auto both = [&] {
    const std::vector<std::int32_t> actions{test_action(0, index), 1, test_action(2, index)};
    plain.step(actions);
    env.step(actions);
    ++index;
    for (const int row : {0, 2}) ASSERT_EQ(shown(env, row), shown(plain, row)) << index;
  };
  for (int i = 0; i < 3; ++i) both();
  armed = true;
  both();
  EXPECT_TRUE(stuck);
  EXPECT_EQ(env.quarantine_counters().of(Fault::stall), 1u);
  EXPECT_TRUE(env.truncated()[1] && env.quarantined()[1] && !env.active()[1]);
  for (const float value : row_of(float_rows(env, "depth"), 3, 1)) ASSERT_EQ(value, 0.f);
  for (int i = 0; i < 5; ++i) both();
  EXPECT_FALSE(env.active()[1]);
  released = true;
  for (int tries = 0; tries < 2000 && !env.active()[1]; ++tries) {
    both();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(env.active()[1]);
  // No action was used there: the first row after its return must not be trained on, and ends the earlier episode.
  EXPECT_TRUE(env.truncated()[1] && env.quarantined()[1] && !env.acted()[1] && !env.terminated()[1]);
  both();
  EXPECT_TRUE(env.acted()[1] && !env.quarantined()[1]);
  for (int i = 0; i < 4; ++i) both();
  EXPECT_TRUE(buffers_are_finite(env));
  EXPECT_EQ(env.quarantine_counters().total(), 1u);
}

}  // namespace
}  // namespace earshot
