// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>

#include "sim/base/errors.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/quarantine_cases.h"

// Quarantined episodes of a batch on two threads, or beside the thread that loads scenes.

namespace earshot {
namespace {

using namespace quarantine_cases;

constexpr std::array kSensorFaults = {Fault::distance, Fault::reward, Fault::pose,        Fault::depth,
                                      Fault::rir,      Fault::sound,  Fault::spectrogram, Fault::pointgoal};
constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();

/// Puts a bad value into what one env's stage makes, once.
struct Poison {
  std::atomic<bool> armed{false};
  Fault kind = Fault::depth;
  int env = 0;
  float value = kNan;
  void operator()(const StageOutput& output, std::span<float> values) {
    if (output.kind != kind || output.env != env || !armed.exchange(false)) return;
    values[values.size() / 2] = value;
  }
};

class QuarantineInBatch : public testing::Test {
 protected:
  static constexpr int kEnvs = 3;
  void SetUp() override {
    config_.task.max_steps = 200;
    config_.threads = 2;
    set_ = make_set(room_episodes(4));
    scenes_ = make_scene_cache(config_);
  }
  EnvConfig config_ = quick_env_config();
  std::shared_ptr<const EpisodeSet> set_;
  std::shared_ptr<SceneCache> scenes_;
};

// Every sensor, three bad values, at the first, the middle and the last env: the episode ends as void in that very step.
TEST_F(QuarantineInBatch, AnyBadNumberEndsItsEpisodeInTheSameStep) {
  BatchedEnv env(config_, set_, scenes_, kEnvs);
  Poison poison;
  env.set_stage_hook([&](const StageOutput& output, std::span<float> values) { poison(output, values); });
  env.reset();
  std::uint64_t faults = 0;
  for (const Fault kind : kSensorFaults)
    for (int row = 0; row < kEnvs; ++row)
      for (const float value : {kNan, kInf, -kInf}) {
        std::vector<std::int32_t> actions(kEnvs, 2);
        if (kind == Fault::distance) actions[static_cast<std::size_t>(row)] = 1;
        poison.kind = kind;
        poison.env = row;
        poison.value = value;
        const int count_before = env.agent(row).episode_count;
        poison.armed = true;
        env.step(actions);
        ASSERT_FALSE(poison.armed) << name_of(kind);
        ++faults;
        const auto at = static_cast<std::size_t>(row);
        EXPECT_EQ(env.quarantined()[at], 1);
        EXPECT_EQ(env.truncated()[at], 1);
        EXPECT_EQ(env.terminated()[at], 0);
        EXPECT_EQ(env.rewards()[at], 0.f);
        EXPECT_EQ(env.active()[at], 1);
        EXPECT_EQ(env.agent(row).episode_count, count_before + 1);
        EXPECT_EQ(env.agent(row).episode_step, 0);
        EXPECT_EQ(std::ranges::count(env.quarantined(), 1), 1);
        ASSERT_TRUE(buffers_are_finite(env)) << name_of(kind) << " " << value;
        for (const auto rows : {final_float_rows(env, "depth"), final_float_rows(env, "spectrogram"), final_float_rows(env, "pointgoal")})
          for (const float x : row_of(rows, kEnvs, row)) ASSERT_EQ(x, 0.f);
        EXPECT_TRUE(env.finished().empty());  // order `random`: no metric of a run knows it
        EXPECT_EQ(env.quarantine_counters().total(), faults);
        env.step(std::vector<std::int32_t>(kEnvs, 3));  // and the mark is gone
        EXPECT_EQ(std::ranges::count(env.quarantined(), 1), 0);
      }
  for (const Fault kind : kSensorFaults) EXPECT_EQ(env.quarantine_counters().of(kind), 9u) << name_of(kind);
  EXPECT_EQ(env.quarantine_counters().nonfinite(), faults);
  EXPECT_EQ(env.quarantine_counters().files_written, 0u);  // no folder was given
}

TEST_F(QuarantineInBatch, OtherEnvsDoNotNoticeAndTheNextEpisodeIsAsFresh) {
  BatchedEnv faulty(config_, set_, scenes_, kEnvs), twin(config_, set_, scenes_, kEnvs), fresh(config_, set_, scenes_, kEnvs);
  Poison poison;
  poison.env = 1;
  poison.kind = Fault::spectrogram;
  faulty.set_stage_hook([&](const StageOutput& output, std::span<float> values) { poison(output, values); });
  faulty.reset();
  twin.reset();
  fresh.reset();
  for (int step = 0; step < 12; ++step) {
    const std::vector<std::int32_t> actions = {step % 3 == 0 ? 2 : 1, 1, 3};
    poison.armed = step == 5;
    faulty.step(actions);
    twin.step(actions);
    for (const int row : {0, 2}) {
      ASSERT_EQ(shown_by(faulty, row), shown_by(twin, row)) << step;
      ASSERT_EQ(faulty.rewards()[static_cast<std::size_t>(row)], twin.rewards()[static_cast<std::size_t>(row)]);
    }
    if (step == 5) {
      ASSERT_EQ(faulty.quarantined()[1], 1);
      ASSERT_FALSE(fresh.begin(1, faulty.agent(1).episode_index, faulty.agent(1).episode_count));
    }
    if (step >= 5) {
      ASSERT_EQ(shown_by(faulty, 1), shown_by(fresh, 1)) << step;
      fresh.step(std::vector<std::int32_t>{2, 1, 2});
    }
  }
}

// A fault in the first observation: the policy never sees the episode, and the bound on draws ends what would spin.
TEST_F(QuarantineInBatch, AFaultAtTheStartIsPassedOver) {
  BatchedEnv env(config_, set_, scenes_, 1);
  env.set_stage_hook([](const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::depth && output.episode_index != 2) values[0] = kNan;
  });
  env.reset();
  EXPECT_EQ(env.agent(0).episode_index, 2u);
  EXPECT_EQ(env.active()[0], 1);
  EXPECT_EQ(env.quarantined()[0], 0);
  EXPECT_TRUE(buffers_are_finite(env));

  env.set_stage_hook([](const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::depth) values[0] = kNan;
  });
  try {
    env.reset();
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("64 episodes in a row"), testing::HasSubstr("depth")));
  }
}

// Every episode begins and then goes wrong: a run that learns nothing ends, and says why.
TEST_F(QuarantineInBatch, NothingButFaultsStopsTheRun) {
  BatchedEnv env(config_, set_, scenes_, 1);
  env.set_stage_hook([](const StageOutput& output, std::span<float> values) {
    if (output.kind == Fault::reward) values[0] = kNan;
  });
  env.reset();
  int steps = 0;
  try {
    for (; steps < 100; ++steps) env.step(std::vector<std::int32_t>{2});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("reward"));
  }
  EXPECT_EQ(steps, 63);
}

TEST_F(QuarantineInBatch, EvaluationCountsAFaultyEpisodeAsFailed) {
  config_.order = EpisodeOrder::once;
  BatchedEnv env(config_, set_, scenes_, 1);
  Poison poison;
  poison.kind = Fault::reward;
  env.set_stage_hook([&](const StageOutput& output, std::span<float> values) { poison(output, values); });
  env.reset();
  std::vector<FinishedEpisode> finished;
  for (int step = 0; step < 8; ++step) {
    poison.armed = step == 3;
    env.step(std::vector<std::int32_t>{step >= 4 ? 0 : 2});
    finished.insert(finished.end(), env.finished().begin(), env.finished().end());
    ASSERT_TRUE(buffers_are_finite(env));
  }
  ASSERT_EQ(finished.size(), 4u);
  EXPECT_EQ(env.active()[0], 0);
  ASSERT_TRUE(finished[0].fault);
  EXPECT_EQ(finished[0].fault->fault, Fault::reward);
  EXPECT_EQ(finished[0].episode_index, 0u);
  EXPECT_EQ(finished[0].actions, (std::vector<std::int8_t>{2, 2, 2, 2}));
  EXPECT_EQ(finished[0].metrics.steps, 4);
  for (const double value : {finished[0].metrics.success, finished[0].metrics.spl, finished[0].metrics.soft_spl, finished[0].metrics.sna})
    EXPECT_EQ(value, 0.0);
  for (std::size_t i = 1; i < finished.size(); ++i) EXPECT_FALSE(finished[i].fault) << i;
}

}  // namespace
}  // namespace earshot
