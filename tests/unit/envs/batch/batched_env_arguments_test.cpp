// SPDX-License-Identifier: Apache-2.0
// What a caller of BatchedEnv can get wrong is an exception in every build, and moves nothing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "envs/batch/batched_env.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

class BatchedEnvArguments : public testing::Test {
 protected:
  static EnvConfig config() {
    EnvConfig config = quick_env_config();
    config.observation.spectrogram = config.observation.depth = false;
    config.observation.pointgoal = true;
    return config;
  }
  EnvConfig config_ = config();
  BatchedEnv env_{config_, make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")}), make_scene_cache(config_),
                  3};
};

TEST_F(BatchedEnvArguments, AnotherNumberOfActionsIsRefused) {
  env_.reset();
  const std::vector<std::int32_t> forward(4, 1);
  for (const std::size_t count : {0u, 2u, 4u})
    EXPECT_THAT([&] { env_.step(std::span(forward).first(count)); },
                ThrowsMessage<std::invalid_argument>(HasSubstr(std::to_string(count) + " actions for 3 environments")));
  EXPECT_EQ(env_.agent(0).episode_step, 0);
  env_.step(std::span(forward).first(3));
  EXPECT_EQ(env_.agent(0).episode_step, 1);
}

TEST_F(BatchedEnvArguments, AnActionOutOfRangeIsRefusedBeforeAnyAgentMoves) {
  env_.reset();
  for (const std::int32_t wrong : {-1, 4, 255, std::numeric_limits<std::int32_t>::min()}) {
    const std::vector<std::int32_t> actions{1, 1, wrong};
    EXPECT_THAT([&] { env_.step(actions); }, ThrowsMessage<std::invalid_argument>(HasSubstr("of environment 2 is outside [0, 4)")));
    EXPECT_EQ(env_.agent(0).episode_step, 0);
  }
}

TEST_F(BatchedEnvArguments, SteppingBeforeTheFirstResetIsRefused) {
  EXPECT_THROW(env_.step(std::vector<std::int32_t>(3, 1)), std::logic_error);
  EXPECT_THROW(static_cast<void>(env_.source(0)), std::logic_error);
}

TEST_F(BatchedEnvArguments, AnEnvironmentOutsideTheBatchIsRefused) {
  env_.reset();
  for (const int env : {-1, 3}) {
    EXPECT_THROW(static_cast<void>(env_.agent(env)), std::out_of_range);
    EXPECT_THROW(static_cast<void>(env_.source(env)), std::out_of_range);
    EXPECT_THROW(env_.begin(env, 0, 0), std::out_of_range);
  }
  EXPECT_THROW(env_.begin(0, 1, 0), std::invalid_argument);
  EXPECT_THROW(env_.begin(0, 0, -1), std::invalid_argument);
}

// Idle environments ignore their action, whatever it is.
TEST_F(BatchedEnvArguments, ActionsOfIdleEnvironmentsAreNotChecked) {
  EnvConfig once = config_;
  once.order = EpisodeOrder::once;
  BatchedEnv env(once, make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")}), make_scene_cache(once), 2);
  env.reset();
  ASSERT_EQ(env.active()[1], 0);
  EXPECT_NO_THROW(env.step(std::vector<std::int32_t>{1, 99}));
}

}  // namespace
}  // namespace earshot
