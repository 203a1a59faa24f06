// SPDX-License-Identifier: Apache-2.0
// Sensors of what no agent could sense, and the interaural one: against what they are made of.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "envs/sensors/sensor_rows.h"
#include "sim/audio/transforms/interaural_spectrogram.h"
#include "tests/support/envs/env_fixture.h"

namespace earshot {
namespace {

EnvConfig config_with_goal_sensors() {
  EnvConfig config = quick_env_config();
  config.observation.oracle_action = config.observation.goal_state = config.observation.interaural = true;
  config.order = EpisodeOrder::once;
  config.task.max_steps = 300;
  return config;
}

std::vector<std::int32_t> oracle_actions(const BatchedEnv& env) {
  std::vector<std::int32_t> actions(static_cast<std::size_t>(env.num_envs()));
  std::memcpy(actions.data(), env.rows("oracle_action").data(), actions.size() * sizeof(std::int32_t));
  return actions;
}

TEST(GoalSensors, FollowingTheOraclesActionsArrives) {
  const EnvConfig config = config_with_goal_sensors();
  const auto set = quick_set(2);
  BatchedEnv env(config, set, make_scene_cache(config), 3);
  env.reset();
  std::size_t done = 0;
  for (int step = 0; step < 900 && done < set->episodes.size(); ++step) {
    env.step(oracle_actions(env));
    for (const FinishedEpisode& episode : env.finished()) {
      EXPECT_EQ(episode.metrics.success, 1) << episode.episode_index;
      EXPECT_TRUE(episode.metrics.stopped);
      ++done;
    }
  }
  EXPECT_EQ(done, set->episodes.size());
}

// In an empty room the way is the straight line: 3-4-5.
TEST(GoalSensors, GoalStateSaysWhereTheGoalIs) {
  const EnvConfig config = config_with_goal_sensors();
  const Episode episode = room_episode("shoebox:6x3x6@0.3", {1, 0, 5}, 0, {4, 0, 1}, "synth:noise");
  BatchedEnv env(config, make_set({episode}), make_scene_cache(config), 1);
  env.reset();
  const auto state = [&] { return float_rows(env, "goal_state"); };
  // Ahead is -z: three metres to the right, four ahead.
  const double bearing_rad = -std::atan2(3.0, 4.0);
  EXPECT_NEAR(state()[0], 5, 0.05);
  EXPECT_NEAR(state()[1], 5, 0.05);
  EXPECT_NEAR(state()[2], bearing_rad, 0.02);
  EXPECT_NEAR(state()[3], bearing_rad, 0.02);
  for (int turn = 0; turn < 3; ++turn) env.step(std::vector<std::int32_t>{2});  // left by 30 degrees: the goal is farther to the right
  EXPECT_NEAR(state()[2], bearing_rad - std::numbers::pi / 6, 0.02);
  env.step(std::vector<std::int32_t>{1});
  EXPECT_LT(state()[0], 5);
}

TEST(GoalSensors, InterauralCellsAreThoseOfTheLastSecond) {
  EnvConfig config = config_with_goal_sensors();
  config.observation.heard = true;
  BatchedEnv env(config, quick_set(2), make_scene_cache(config), 2);
  env.reset();
  const SpectrogramConfig& sound = config.observation.sound;
  InterauralAnalyzer analyzer(sound);
  std::vector<float> cells(static_cast<std::size_t>(sound.rows() * sound.columns() * kInterauralChannels));
  for (int step = 0; step < 6; ++step) {
    const auto heard = float_rows(env, "heard"), shown = float_rows(env, "interaural");
    for (std::size_t row = 0; row < 2; ++row) {
      InterauralHistory empty_history;
      analyzer.analyze(heard.subspan(row * 32000, 32000), 0, empty_history, cells);
      ASSERT_TRUE(std::ranges::equal(cells, shown.subspan(row * cells.size(), cells.size()))) << step;
    }
    env.step(std::vector<std::int32_t>{1, 2});
  }
}

}  // namespace
}  // namespace earshot
