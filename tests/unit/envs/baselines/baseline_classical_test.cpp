// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/baseline_classical.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "tests/support/envs/env_fixture.h"

namespace earshot {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
const std::string kRoom = "shoebox:12x3x12@0.6";

EnvConfig classical_config() {
  EnvConfig config = quick_env_config();
  config.observation.camera.width_px = config.observation.camera.height_px = 64;
  config.order = EpisodeOrder::once;
  config.task.max_steps = 150;
  return config;
}

/// Nothing but the direct sound: a head in the open.
EnvConfig open_config() {
  EnvConfig config = classical_config();
  config.acoustics.late = config.acoustics.early = Switch::off;
  return config;
}

BaselineObservation observation_of(const BatchedEnv& env) {
  return {.heard = float_rows(env, "heard"),
          .new_samples = float_rows(env, "waveform").size() / 2,
          .depth = float_rows(env, "depth"),
          .collided = env.collided()[0] != 0};
}

/// Actions of each episode, by its number in the set.
std::map<std::uint64_t, std::vector<std::int8_t>> roll_out(const EnvConfig& config, const std::shared_ptr<const EpisodeSet>& set, int envs,
                                                           int* successes = nullptr) {
  BatchedEnv env(config, set, make_scene_cache(config), envs);
  env.reset();
  BaselineAgent agent(Baseline::classical, config, envs, 5);
  std::vector<std::int32_t> actions(static_cast<std::size_t>(envs));
  std::map<std::uint64_t, std::vector<std::int8_t>> all;
  while (std::ranges::any_of(env.active(), [](std::uint8_t active) { return active != 0; })) {
    agent.act(env, actions);
    env.step(actions);
    for (const FinishedEpisode& end : env.finished()) {
      all[end.episode_index] = end.actions;
      if (successes) *successes += end.metrics.success > 0;
    }
  }
  return all;
}

// In the open, at 4 m, both ears by the rigid sphere: 10 degrees in front, as far as 60 to a side.
TEST(ClassicalAgent, BearingInTheOpenIsThatOfTheSource) {
  const EnvConfig config = open_config();
  std::vector<Episode> episodes;
  for (int degrees = -60; degrees <= 60; degrees += 15) {
    const double angle = degrees * kDegree;
    episodes.push_back(room_episode("shoebox:16x3x16@1", {8, 0, 8}, 0,
                                    {8 - 4 * static_cast<float>(std::sin(angle)), 0, 8 - 4 * static_cast<float>(std::cos(angle))},
                                    "synth:noise"));
  }
  const int count = static_cast<int>(episodes.size());
  BatchedEnv env(config, make_set(std::move(episodes)), make_scene_cache(config), count);
  env.reset();
  InterauralBearing ears(config.acoustics.sample_rate_hz);
  std::vector<float> response(InterauralBearing::kNumAngles);
  const std::size_t size = float_rows(env, "waveform").size() / static_cast<std::size_t>(count);
  for (int i = 0; i < count; ++i) {
    const auto estimate = ears.estimate(float_rows(env, "waveform").subspan(static_cast<std::size_t>(i) * size, size), response);
    ASSERT_FALSE(estimate.silent);
    EXPECT_NEAR(estimate.lateral_rad / kDegree, -60 + 15 * i, 10.0);
  }
}

TEST(BearingMemory, TurningTellsFrontFromBack) {
  for (const double source_deg : {150.0, -120.0, 30.0}) {
    const EnvConfig config = open_config();
    const double angle = source_deg * kDegree;
    BatchedEnv env(config,
                   make_set({room_episode("shoebox:16x3x16@1", {8, 0, 8}, 0,
                                          {8 - 4 * static_cast<float>(std::sin(angle)), 0, 8 - 4 * static_cast<float>(std::cos(angle))},
                                          "synth:noise")}),
                   make_scene_cache(config), 1);
    env.reset();
    InterauralBearing ears(config.acoustics.sample_rate_hz);
    std::vector<float> response(InterauralBearing::kNumAngles);
    BearingMemory memory;
    EXPECT_FALSE(memory.bearing_rad());
    const std::vector<std::int32_t> left = {static_cast<std::int32_t>(Action::left)};
    for (int turn = 0; turn < 6; ++turn) {
      ears.estimate(float_rows(env, "waveform"), response);
      memory.add(turn * 10 * kDegree, response);
      env.step(left);
    }
    ASSERT_TRUE(memory.bearing_rad());
    EXPECT_NEAR(std::remainder(*memory.bearing_rad() - angle, 2 * std::numbers::pi) / kDegree, 0, 15.0);  // 10, and a bin to either side
  }
}

TEST(ClassicalAgent, FindsTheGoalInAnEmptyRoom) {
  const EnvConfig config = classical_config();
  std::vector<Episode> episodes;
  for (int i = 0; i < 4; ++i)
    episodes.push_back(room_episode(kRoom, {9, 0, 9}, i * 1.5, {3, 0, 2.f + static_cast<float>(i)}, "synth:noise:" + std::to_string(i)));
  int successes = 0;
  EXPECT_EQ(roll_out(config, make_set(std::move(episodes)), 4, &successes).size(), 4u);
  EXPECT_EQ(successes, 4);
}

// A house has walls to collide with and to slide along.  0.25 m: a step and a half, so that the map stays usable.
TEST(ClassicalAgent, KnowsWhereItIsFromItsOwnActions) {
  EnvConfig config = classical_config();
  config.task.max_steps = 120;
  const auto set = quick_set(2);
  for (std::size_t i = 0; i < 2; ++i) {
    BatchedEnv env(config, make_set({set->episodes[i]}), make_scene_cache(config), 1);
    env.reset();
    ClassicalAgent agent(config);
    agent.begin();
    const Pose start = env.agent(0).pose;
    const RandomStream random(5, Purpose::random_agent);
    std::vector<std::int32_t> actions(1);
    for (;;) {
      actions[0] = static_cast<std::int32_t>(agent.act(observation_of(env), random));
      const glm::vec3 moved = env.agent(0).pose.position - start.position;
      const glm::vec3 ahead = forward_of(start.heading_rad), right = right_of(start.heading_rad);
      EXPECT_NEAR(agent.pose().x_m, static_cast<double>(glm::dot(moved, right)), 0.25);
      EXPECT_NEAR(-agent.pose().z_m, static_cast<double>(glm::dot(moved, ahead)), 0.25);
      if (actions[0] == 0 || env.agent(0).episode_step + 1 >= config.task.max_steps) break;
      env.step(actions);
    }
  }
}

TEST(ClassicalAgent, SameBitsForAnyThreadsAndAnyBatch) {
  EnvConfig config = classical_config();
  config.task.max_steps = 40;
  const auto set = quick_set(1);
  const auto alone = roll_out(config, set, 1);
  config.threads = 3;
  EXPECT_EQ(roll_out(config, set, 1), alone);
  config.threads = 2;
  const auto reference = roll_out(config, set, 3);
  config.threads = 1;
  EXPECT_EQ(roll_out(config, set, 3), reference);
}

/// Actions of the first episode of this env, by `agent`.
std::vector<std::int32_t> walk(const EnvConfig& config, const Episode& episode, BaselineAgent& agent) {
  BatchedEnv env(config, make_set({episode}), make_scene_cache(config), 1);
  env.reset();
  std::vector<std::int32_t> actions(1), all;
  while (env.active()[0] != 0) {
    agent.act(env, actions);
    all.push_back(actions[0]);
    env.step(actions);
  }
  return all;
}

TEST(ClassicalAgent, AnEpisodeRemembersNothingOfTheLast) {
  EnvConfig config = classical_config();
  config.task.max_steps = 60;
  const Episode one = room_episode(kRoom, {9, 0, 9}, 1, {3, 0, 4}, "synth:noise"),
                other = room_episode(kRoom, {4, 0, 9}, 2, {9, 0, 2}, "synth:noise");
  for (const Baseline baseline : {Baseline::greedy, Baseline::classical}) {
    BaselineAgent fresh(baseline, config, 1, 5), used(baseline, config, 1, 5);
    const auto expected = walk(config, one, fresh);
    EXPECT_NE(walk(config, other, used), expected);
    EXPECT_EQ(walk(config, one, used), expected);
  }
}

TEST(ClassicalAgent, SaysWhichSensorIsMissing) {
  EnvConfig config = classical_config();
  config.observation.depth = false;
  EXPECT_THROW(ClassicalAgent{config}, InputError);
}

}  // namespace
}  // namespace earshot
