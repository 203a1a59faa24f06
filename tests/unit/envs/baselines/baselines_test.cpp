// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/baselines.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numbers>

#include "tests/support/envs/env_fixture.h"

namespace earshot {
namespace {

struct Score {
  double success = 0, spl = 0, sna = 0;
  int episodes = 0;
};

Score score(Baseline baseline, const EnvConfig& config, const std::shared_ptr<const EpisodeSet>& set, int envs) {
  BatchedEnv env(config, set, make_scene_cache(config), envs);
  env.reset();
  BaselineAgent agent(baseline, config, envs, 5);
  std::vector<std::int32_t> actions(static_cast<std::size_t>(envs));
  Score total;
  while (std::ranges::any_of(env.active(), [](std::uint8_t active) { return active != 0; })) {
    agent.act(env, actions);
    env.step(actions);
    for (const FinishedEpisode& end : env.finished()) {
      total.success += end.metrics.success;
      total.spl += end.metrics.spl;
      total.sna += end.metrics.sna;
      ++total.episodes;
    }
  }
  return total;
}

TEST(Baselines, NamesAreKnown) {
  EXPECT_EQ(baseline_by_name("random"), Baseline::random);
  EXPECT_EQ(baseline_by_name("greedy"), Baseline::greedy);
  EXPECT_EQ(baseline_by_name("oracle"), Baseline::oracle);
  EXPECT_EQ(baseline_by_name("random_oracle_stop"), Baseline::random_oracle_stop);
  EXPECT_FALSE(baseline_by_name("Oracle"));
}

TEST(Baselines, TheOracleSucceedsWithItsOwnCountOfActions) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = false;
  config.order = EpisodeOrder::once;
  config.task.max_steps = 500;
  const Score oracle = score(Baseline::oracle, config, quick_set(5), 4);
  EXPECT_EQ(oracle.episodes, 15);
  EXPECT_EQ(oracle.success, 15);
  EXPECT_NEAR(oracle.sna, 15, 1e-9);  // it is what SNA compares with
  EXPECT_GT(oracle.spl / 15, 0.9);
}

TEST(Baselines, RandomActionsAreUniformAndKeyed) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = false;
  const auto set = quick_set(2);
  const auto scenes = make_scene_cache(config);
  BatchedEnv whole(config, set, scenes, 4), half(config, set, scenes, 2, 2, 4);
  whole.reset();
  half.reset();
  BaselineAgent of_whole(Baseline::random, config, 4, 5), of_other(Baseline::random, config, 2, 5, 2);
  std::vector<std::int32_t> actions(4), of_half(2);
  std::map<int, int> counts;
  const int steps = 400;
  for (int i = 0; i < steps; ++i) {
    of_whole.act(whole, actions);
    of_other.act(half, of_half);
    EXPECT_EQ(actions[2], of_half[0]);
    EXPECT_EQ(actions[3], of_half[1]);
    for (const std::int32_t action : actions) ++counts[action];
    whole.step(actions);
    half.step(of_half);
  }
  for (int action = 0; action < 4; ++action) EXPECT_NEAR(counts[action], steps, 4 * std::sqrt(steps * 0.75));  // four sigma, binomial
}

TEST(Baselines, RandomWithTheOraclesStopNeverStopsElsewhere) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = false;
  config.task.max_steps = 200;
  config.task.success_radius_m = 2;
  const std::string room = "shoebox:3x3x3@0.5";  // small enough to come across the goal
  const auto set = make_set({room_episode(room, {0.5f, 0, 0.5f}, 0, {2.2f, 0, 2.2f}, "synth:noise")});
  BatchedEnv env(config, set, make_scene_cache(config), 4);
  env.reset();
  BaselineAgent agent(Baseline::random_oracle_stop, config, 4, 5);
  std::vector<std::int32_t> actions(4);
  int stops = 0;
  for (int step = 0; step < 1000; ++step) {
    agent.act(env, actions);
    for (int row = 0; row < 4; ++row) {
      const bool is_at_goal = *env.goal(row).distance_m(env.agent(row).pose.position) < 0.5f * config.task.success_radius_m;
      const bool stop = actions[static_cast<std::size_t>(row)] == 0;
      EXPECT_EQ(stop, is_at_goal);
      stops += stop;
    }
    env.step(actions);
  }
  EXPECT_GT(stops, 4);
}

TEST(Baselines, GreedyEscapesFromACorner) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  config.observation.camera.width_px = config.observation.camera.height_px = 64;
  config.acoustics.late = config.acoustics.early = Switch::off;
  config.task.max_steps = 80;
  // It looks into the corner; the sound is right behind, the same at both ears.
  const auto set = make_set({room_episode("shoebox:8x3x8@0.5", {0.5f, 0, 0.5f}, 0.25 * std::numbers::pi, {7, 0, 7}, "synth:noise")});
  BatchedEnv env(config, set, make_scene_cache(config), 1);
  env.reset();
  BaselineAgent agent(Baseline::greedy, config, 1, 5);
  std::vector<std::int32_t> actions(1);
  float farthest_m = 0;
  while (env.active()[0] != 0) {
    agent.act(env, actions);
    env.step(actions);
    if (env.active()[0] == 0) break;
    const glm::vec3 position = env.agent(0).pose.position;
    farthest_m = std::max(farthest_m, std::hypot(position.x - 0.5f, position.z - 0.5f));
  }
  EXPECT_GT(farthest_m, 2.f);
}

TEST(Baselines, GreedyTurnsToTheLouderEar) {
  EnvConfig config = quick_env_config();
  config.acoustics.late = config.acoustics.early = Switch::off;
  config.order = EpisodeOrder::once;
  const std::string room = "shoebox:16x3x16@1";
  const auto set = make_set(
      {room_episode(room, {8, 0, 8}, 0, {3, 0, 8}, "synth:noise"),       // to the left
       room_episode(room, {8, 0, 8}, 0, {13, 0, 8}, "synth:noise"),      // to the right
       room_episode(room, {8, 0, 8}, 0, {8, 0, 3}, "synth:noise"),       // ahead
       room_episode(room, {8, 0, 8}, 0, {7.6f, 0, 8}, "synth:noise")});  // here: at an ear, as a head is 2 dB quieter in front at 0.4 m
  BatchedEnv env(config, set, make_scene_cache(config), 4);
  env.reset();
  std::vector<std::int32_t> actions(4);
  BaselineAgent(Baseline::greedy, config, 4, 5).act(env, actions);
  EXPECT_EQ(actions, (std::vector<std::int32_t>{2, 3, 1, 0}));
}

TEST(Baselines, GreedyFindsASourceInAnOpenRoom) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  config.task.max_steps = 150;
  const std::string room = "shoebox:12x3x12@0.6";
  std::vector<Episode> episodes;
  for (int i = 0; i < 4; ++i)
    episodes.push_back(room_episode(room, {9, 0, 9}, i * 1.0, {3, 0, 2.f + static_cast<float>(i)}, "synth:noise:" + std::to_string(i)));
  const auto set = make_set(std::move(episodes));
  const Score greedy = score(Baseline::greedy, config, set, 4), random = score(Baseline::random, config, set, 4);
  EXPECT_GE(greedy.success, 3);
  EXPECT_EQ(random.success, 0);  // a quarter of its actions is stop: it ends metres away
}

}  // namespace
}  // namespace earshot
