// SPDX-License-Identifier: Apache-2.0
// Several agents in one env: rows, what they hear and see of each other, and how they pass.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "sim/vision/agent_body.h"
#include "tests/support/envs/agents_fixture.h"

namespace earshot {
namespace {

TEST_F(SeveralAgents, RowsAreEnvTimesAgent) {
  BatchedEnv env(config_, set_, scenes_, 2);
  EXPECT_EQ(env.num_envs(), 2);
  EXPECT_EQ(env.config().agents, 3);
  EXPECT_EQ(env.num_rows(), 6);
  env.reset();
  EXPECT_EQ(env.rewards().size(), 6u);
  EXPECT_EQ(float_rows(env, "depth").size(), 6u * 16 * 16);
  EXPECT_EQ(float_rows(env, "pointgoal").size(), 12u);
  for (int row = 0; row < 6; ++row) {
    const Episode& episode = set_->episodes[env.agent(row).episode_index];
    const int agent = row % 3;
    const glm::dvec3 start = agent == 0 ? episode.start_position : episode.other_agents[static_cast<std::size_t>(agent - 1)].start_position;
    const EnvScene& scene = *env.source(row).scene;
    EXPECT_EQ(env.agent(row).pose.position, scene.navmesh.snap(scene.scene->to_local(start)).value()) << row;
    EXPECT_EQ(env.agent(row).episode_index, env.agent(row / 3 * 3).episode_index);
    EXPECT_TRUE(env.active()[static_cast<std::size_t>(row)]);
  }
  EXPECT_THROW(env.step(std::vector<std::int32_t>{1, 1}), std::invalid_argument);
  EXPECT_THROW(env.send(std::vector<std::int32_t>{0}, std::vector<std::int32_t>{1}), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(env.agent(6).pose), std::out_of_range);
  EXPECT_THROW(static_cast<void>(env.snapshot(2)), std::out_of_range);
  env.step(std::vector<std::int32_t>{1, 1, 1, 2, 2, 2});
  for (int row = 3; row < 6; ++row) EXPECT_EQ(env.agent(row).episode_step, 1);
}

// The first agent among silent ones hears what it hears alone, and takes its way.
TEST_F(SeveralAgents, AgentsWithoutSoundsAreNotHeard) {
  std::vector<Episode> silent = set_->episodes, alone = silent;
  for (Episode& episode : silent) {
    episode.agent_sound.clear();
    for (EpisodeAgent& agent : episode.other_agents) agent.sound.clear();
  }
  EnvConfig single_agent = config_;
  single_agent.agents = 1;
  BatchedEnv several(config_, make_set(silent), scenes_, 1), single(single_agent, make_set(alone), scenes_, 1);
  several.reset();
  single.reset();
  for (int step = 0; step < 10; ++step) {
    several.step(std::vector<std::int32_t>{kLeft, kForward, kLeft});
    single.step(std::vector<std::int32_t>{kLeft});
    EXPECT_EQ(row_of(float_rows(several, "waveform"), 3, 0), row_of(float_rows(single, "waveform"), 1, 0)) << step;
    EXPECT_EQ(row_of(float_rows(several, "spectrogram"), 3, 0), row_of(float_rows(single, "spectrogram"), 1, 0)) << step;
    EXPECT_EQ(several.rewards()[0], single.rewards()[0]);
  }
}

// An agent's sound is that of a moving source on the agent's way, bit for bit; and what both bring is the sum of what each brings.
TEST(Agents, AreHeardAsMovingSourcesOnTheirWay) {
  EnvConfig config = two_agents();
  config.observation.depth = config.observation.semantic = false;
  config.observation.waveform = config.observation.heard = true;
  const auto scenes = make_scene_cache(config);
  constexpr int kSteps = 30;
  // The second walks towards the first and past it; the first turns.
  Episode together = two_in_a_room({6, 0, 3.5}, "synth:speech:3");
  together.sources = {{.position = {7, 0, 1}, .sound = "synth:noise", .goal = true}};
  BatchedEnv env(config, make_set({together}), scenes, 1);
  env.reset();
  std::vector<std::vector<float>> heard;
  Episode apart = together;
  apart.other_agents.clear();
  EpisodeSource walker{.position = {6, 0, 3.5}, .sound = "synth:speech:3"};
  heard.push_back(row_of(float_rows(env, "heard"), 2, 0));
  walker.position = glm::dvec3(env.agent(1).pose.position);
  walker.path = {{0, walker.position}};
  for (int step = 0; step < kSteps; ++step) {
    env.step(std::vector<std::int32_t>{step % 3 == 0 ? kLeft : kForward, step % 5 == 4 ? kLeft : kForward});
    heard.push_back(row_of(float_rows(env, "waveform"), 2, 0));
    walker.path.push_back({0.15 * (step + 1), glm::dvec3(env.agent(1).pose.position)});
  }
  ASSERT_GT(glm::distance(glm::vec3(walker.path.front().position), glm::vec3(walker.path.back().position)), 1.f);

  EnvConfig single_agent = config;
  single_agent.agents = 1;
  const auto listen = [&](std::vector<EpisodeSource> sources) {
    Episode episode = apart;
    episode.sources = std::move(sources);
    BatchedEnv single(single_agent, make_set({episode}), scenes, 1);
    single.reset();
    std::vector<std::vector<float>> blocks{row_of(float_rows(single, "heard"), 1, 0)};
    for (int step = 0; step < kSteps; ++step) {
      single.step(std::vector<std::int32_t>{step % 3 == 0 ? kLeft : kForward});
      blocks.push_back(row_of(float_rows(single, "waveform"), 1, 0));
    }
    return blocks;
  };
  const EpisodeSource goal = together.sources[0];
  EXPECT_EQ(heard, listen({goal, walker}));
  const auto a = listen({goal}), b = listen({walker});
  double largest = 0, worst = 0, walker_largest = 0;
  for (std::size_t step = 0; step < heard.size(); ++step)
    for (std::size_t i = 0; i < heard[step].size(); ++i) {
      largest = std::max(largest, std::abs(double{heard[step][i]}));
      walker_largest = std::max(walker_largest, std::abs(double{b[step][i]}));
      worst = std::max(worst, std::abs(double{heard[step][i]} - double{a[step][i]} - double{b[step][i]}));
    }
  EXPECT_GT(walker_largest, 1e-3);
  EXPECT_LT(worst, 1e-6 * largest);
}

// In the open, at 1 and 4 m: 12 dB, and none hears itself.
TEST(Agents, LevelsFallWithDistanceAndNoneHearsItself) {
  EnvConfig config = two_agents();
  config.observation.depth = config.observation.semantic = false;
  config.observation.waveform = true;
  config.acoustics.early = config.acoustics.late = config.acoustics.diffraction = Switch::off;
  config.acoustics.air_absorption = Switch::off;
  const auto scenes = make_scene_cache(config);
  const auto energy_at = [&](double away_m, std::size_t listener) {
    Episode episode = two_in_a_room({1 + away_m, 0, 4}, "synth:noise");
    episode.sources = {{.position = {7, 0, 1}, .sound = "synth:noise", .onset_s = 100, .goal = true}};
    BatchedEnv env(config, make_set({episode}), scenes, 1);
    env.reset();
    double sum = 0;
    for (int step = 0; step < 40; ++step) {
      env.step(std::vector<std::int32_t>{kLeft, kLeft});
      for (const float sample : row_of(float_rows(env, "waveform"), 2, static_cast<int>(listener))) sum += double{sample} * double{sample};
    }
    return sum;
  };
  // Over several loops of the sound; the head turns once and more.
  EXPECT_NEAR(10 * std::log10(energy_at(1, 0) / energy_at(4, 0)), 20 * std::log10(4.0), 0.3);
  EXPECT_EQ(energy_at(1, 1), 0.0);
}

// A cylinder of 0.1 m, 2 m ahead and 1.5 m high: the ray of a pixel at slope s meets it at depth t, (t s)^2 + (t - d)^2 = r^2.
TEST(Agents, SeeEachOtherAsCylinders) {
  EnvConfig config = two_agents();
  config.observation.camera.width_px = config.observation.camera.height_px = 64;
  const auto scenes = make_scene_cache(config);
  BatchedEnv env(config, make_set({two_in_a_room({3, 0, 4})}), scenes, 1);
  env.reset();
  const auto semantic = [&](int row) {
    const auto bytes = row_of(env.rows("semantic"), 2, row);
    std::vector<std::uint16_t> values(bytes.size() / 2);
    std::copy_n(bytes.begin(), bytes.size(), std::as_writable_bytes(std::span(values)).begin());
    return values;
  };
  const auto check = [&](double away_m) {
    int pixels = 0;
    for (int row = 0; row < 2; ++row) {
      const auto depth = row_of(float_rows(env, "depth"), 2, row);
      const auto category = semantic(row);
      for (std::size_t column = 28; column < 36; ++column) {
        const std::size_t pixel = 32 * 64 + column;
        const double s = (static_cast<double>(column) + 0.5 - 32) / 32, root = away_m * away_m - (1 + s * s) * (away_m * away_m - 0.01);
        if (std::abs(root) < 1e-4) continue;
        EXPECT_EQ(category[pixel] == agent_category(), root > 0) << column;
        if (root < 0) continue;
        ++pixels;
        EXPECT_NEAR(depth[pixel], (away_m - std::sqrt(root)) / (1 + s * s) / 10, 2e-6) << column;
      }
    }
    return pixels;
  };
  EXPECT_GE(check(2.0), 4);
  // Only the other moves: what one sees is drawn anew.
  for (int step = 0; step < 3; ++step) env.step(std::vector<std::int32_t>{kForward, 2 + step % 2});
  env.step(std::vector<std::int32_t>{kForward, 3});
  for (int row = 0; row < 2; ++row) EXPECT_EQ(std::ranges::count(semantic(row), agent_category()) > 0, true);
  const double apart_m = glm::distance(env.agent(0).pose.position, env.agent(1).pose.position);
  EXPECT_NEAR(apart_m, 1.4, 1e-3);
}

// Head on: they stop where their discs touch, 0.2 m apart, and say so; sideways they pass.
TEST(Agents, DoNotGoThroughEachOther) {
  EnvConfig config = two_agents();
  config.observation.spectrogram = config.observation.depth = config.observation.semantic = false;
  const auto scenes = make_scene_cache(config);
  BatchedEnv env(config, make_set({two_in_a_room({2, 0, 4})}), scenes, 1);
  env.reset();
  for (int step = 0; step < 8; ++step) {
    env.step(std::vector<std::int32_t>{kForward, kForward});
    ASSERT_GE(glm::distance(env.agent(0).pose.position, env.agent(1).pose.position), 0.2f);
  }
  EXPECT_NEAR(glm::distance(env.agent(0).pose.position, env.agent(1).pose.position), 0.2, 1e-3);
  EXPECT_TRUE(env.collided()[0] && env.collided()[1]);
  // By number: the first came 0.45 m in three steps, the second 0.35 m in what was left.
  EXPECT_NEAR(env.agent(0).pose.position.x, 1.45, 0.01);
  const glm::vec3 stood = env.agent(0).pose.position;
  for (int turn = 0; turn < 18; ++turn) env.step(std::vector<std::int32_t>{kLeft, kLeft});
  env.step(std::vector<std::int32_t>{kForward, kForward});
  EXPECT_FALSE(env.collided()[0] || env.collided()[1]);  // away from each other
  EXPECT_NEAR(glm::distance(env.agent(0).pose.position, stood), 0.15, 1e-3);
}

TEST(Agents, FreeFractionIsThatOfTwoDiscs) {
  const BodiesAround around{.places = {{3, 0, 0}}, .apart_m = 0.5f, .height_m = 1.5f};
  EXPECT_EQ(free_fraction(around, {0, 0, 0}, {2, 0, 0}), 1.0);
  EXPECT_NEAR(free_fraction(around, {0, 0, 0}, {4, 0, 0}), 2.5 / 4, 1e-4);
  EXPECT_NEAR(free_fraction(around, {0, 0, 0.3f}, {4, 0, 0.3f}), (3 - 0.4) / 4, 1e-4);  // sqrt(0.25 - 0.09)
  EXPECT_EQ(free_fraction(around, {0, 0, 0.51f}, {4, 0, 0.51f}), 1.0);
  EXPECT_EQ(free_fraction(around, {0, 2, 0}, {4, 2, 0}), 1.0);        // on the floor above
  EXPECT_EQ(free_fraction(around, {2.7f, 0, 0}, {2.8f, 0, 0}), 0.0);  // into one that it overlaps
  EXPECT_EQ(free_fraction(around, {2.7f, 0, 0}, {2.6f, 0, 0}), 1.0);  // out of it
}

}  // namespace
}  // namespace earshot
