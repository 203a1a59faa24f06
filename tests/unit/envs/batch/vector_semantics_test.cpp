// SPDX-License-Identifier: Apache-2.0
// How a batch is driven: which envs are reset, what follows an end, stepping in the background, and moving envs between batches.  Every
// claim is one about bits.
#include "tests/support/envs/vector_semantics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <set>
#include <stdexcept>

#include "envs/sensors/sensor_rows.h"
#include "sim/base/errors.h"
#include "sim/scene/appearance.h"
#include "sim/vision/embree_camera.h"

namespace earshot {
namespace {

// The claims below are about every sensor that there is.
TEST_F(VectorSemantics, TheConfigHasAllSensors) {
  BatchedEnv env = make(1, config_);
  std::set<SensorKind> kinds;
  for (const SensorSpec& sensor : env.sensors()) kinds.insert(sensor.kind);
  EXPECT_EQ(kinds.size(), kNumSensorKinds);
}

TEST_F(VectorSemantics, SensorsOfTheWaySayWhatTheAgentDid) {
  config_.order = EpisodeOrder::once;
  BatchedEnv env(config_, make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {5, 0, 4}, "synth:noise")}), scenes_, 1);
  env.reset();
  const auto floats = [&](std::string_view name, bool final = false) { return as_floats(final ? env.final_rows(name) : env.rows(name)); };
  const auto integer = [&](std::string_view name) {
    std::int32_t value = -99;
    std::ranges::copy(env.rows(name), std::as_writable_bytes(std::span(&value, 1)).begin());
    return value;
  };
  EXPECT_THAT(floats("gps_compass"), testing::ElementsAre(0.f, 0.f, 0.f));
  EXPECT_EQ(integer("previous_action"), -1);
  for (int turn = 0; turn < 9; ++turn) env.step(std::vector<std::int32_t>{3});  // right by 90 degrees
  for (int move = 0; move < 4; ++move) env.step(std::vector<std::int32_t>{1});
  EXPECT_EQ(integer("previous_action"), 1);
  EXPECT_NEAR(floats("gps_compass")[0], 0, 1e-5);
  EXPECT_NEAR(floats("gps_compass")[1], 0.6, 1e-5);
  EXPECT_NEAR(floats("gps_compass")[2], -std::numbers::pi / 2, 1e-6);
  EXPECT_NEAR(floats("pose")[3], 13 * 0.15, 1e-6);
  EXPECT_EQ(floats("waveform").size(), 2u * 2400u);
  EXPECT_TRUE(std::ranges::equal(floats("waveform").subspan(0, 2400), floats("heard").subspan(16000 - 2400, 2400)));
}

TEST_F(VectorSemantics, CamerasSeeFromWhereTheAgentStands) {
  config_.observation.depth_noise = false;
  BatchedEnv env = make(2, config_);
  env.reset();
  for (int i = 0; i < 5; ++i) step(env, i);
  const std::vector<ExtraCamera> cameras = config_.observation.all_cameras();
  ASSERT_EQ(cameras.size(), 2u);
  for (int row = 0; row < 2; ++row) {
    const Scene& scene = *env.source(row).scene->scene;
    const auto appearance = load_appearance(scene);
    std::vector<std::uint8_t> rgb(16 * 16 * 3);
    std::vector<std::uint16_t> semantic(16 * 16);
    std::vector<float> normals(16 * 8 * 3);
    EmbreeCamera(cameras[0].config).render(scene, appearance.get(), env.agent(row).pose, {.rgb = rgb, .semantic = semantic});
    EmbreeCamera(cameras[1].config).render(scene, nullptr, env.agent(row).pose, {.normals = normals});
    const auto check = [&](std::string_view name, std::span<const std::byte> expected) {
      for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor) {
        if (env.sensors()[sensor].name != name) continue;
        EXPECT_TRUE(std::ranges::equal(row_of(env.rows(env.sensors()[sensor].name), 2, row), expected)) << name;
      }
    };
    check("rgb", std::as_bytes(std::span(rgb)));
    check("semantic", std::as_bytes(std::span(semantic)));
    check("around_normals", std::as_bytes(std::span(normals)));
    EXPECT_GT(*std::ranges::max_element(rgb), 40);
  }
}

// Bits of the sequence of an env with a seed of its own do not depend on where it runs, and are reached again.
TEST_F(VectorSemantics, ASeedOfItsOwnGivesTheSameEpisodesInAnyEnv) {
  BatchedEnv a = make(3, config_), b = make(5, config_);
  a.reset();
  b.reset();
  for (int i = 0; i < 7; ++i) step(b, i);
  a.reset(std::vector<std::uint8_t>{0, 1, 1}, std::vector<std::uint64_t>{0, 7, 8});
  b.reset(std::vector<std::uint8_t>{0, 0, 0, 0, 1}, std::vector<std::uint64_t>{0, 0, 0, 0, 7});
  EXPECT_EQ(shown(a, 1), shown(b, 4));
  EXPECT_NE(shown(a, 2), shown(b, 4));
  for (int i = 0; i < 40; ++i) {  // over ends of episodes
    std::vector<std::int32_t> actions_a(3, 1), actions_b(5, 2);
    actions_a[1] = actions_b[4] = test_action(9, i);
    a.step(actions_a);
    b.step(actions_b);
    ASSERT_EQ(shown(a, 1), shown(b, 4)) << i;
  }
  EXPECT_GT(a.agent(1).episode_count, 0);
}

TEST_F(VectorSemantics, AMaskLeavesTheOthersAsTheyAre) {
  BatchedEnv env = make(4, config_), plain = make(4, config_);
  for (BatchedEnv* batch : {&env, &plain}) {
    batch->reset();
    for (int i = 0; i < 5; ++i) step(*batch, i);
  }
  const std::vector<int> counts{env.agent(0).episode_count, env.agent(2).episode_count};
  env.reset(std::vector<std::uint8_t>{1, 0, 1, 0});
  for (const int row : {1, 3}) EXPECT_EQ(shown(env, row), shown(plain, row));
  EXPECT_EQ(env.agent(0).episode_count, counts[0] + 1);
  EXPECT_EQ(env.agent(2).episode_count, counts[1] + 1);
  EXPECT_EQ(env.agent(0).episode_step, 0);
  for (int i = 5; i < 12; ++i) {
    step(env, i);
    step(plain, i);
    for (const int row : {1, 3}) ASSERT_EQ(shown(env, row), shown(plain, row)) << i;
  }
}

// The three modes show the same episodes: what differs is when the next one begins.
TEST_F(VectorSemantics, AutoresetModesShowTheSameEpisodes) {
  EnvConfig next_step = config_, off = config_;
  next_step.autoreset = Autoreset::next_step;
  off.autoreset = Autoreset::off;
  BatchedEnv a = make(1, config_), b = make(1, next_step), c = make(1, off);
  for (BatchedEnv* env : {&a, &b, &c}) env->reset();
  const auto now = [](const BatchedEnv& env) {
    std::vector<std::byte> all;
    for (std::size_t sensor = 0; sensor < env.sensors().size(); ++sensor)
      roll_outs::append_row(all, env.rows(env.sensors()[sensor].name), 0, 1);
    return all;
  };
  int ends = 0;
  for (int i = 0; i < 60; ++i) {
    const std::vector<std::int32_t> action{test_action(0, i)};
    for (BatchedEnv* env : {&a, &b, &c}) env->step(action);
    ASSERT_EQ(a.rewards()[0], b.rewards()[0]);
    ASSERT_EQ(a.terminated()[0], c.terminated()[0]);
    ASSERT_EQ(a.truncated()[0], b.truncated()[0]);
    if (a.terminated()[0] || a.truncated()[0]) {
      ++ends;
      EXPECT_EQ(now(b), now(c));  // the last of the episode
      for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor) {
        EXPECT_TRUE(std::ranges::equal(a.final_rows(a.sensors()[sensor].name), b.rows(b.sensors()[sensor].name)))
            << a.sensors()[sensor].name;
        EXPECT_TRUE(std::ranges::equal(c.final_rows(c.sensors()[sensor].name), c.rows(c.sensors()[sensor].name)));
      }
      ASSERT_EQ(b.finished().size(), 1u);
      EXPECT_EQ(a.finished()[0].actions, b.finished()[0].actions);
      EXPECT_THROW(c.step(action), std::logic_error);
      c.reset(std::vector<std::uint8_t>{1});
      b.step(std::vector<std::int32_t>{99});  // not used, and so not refused
      EXPECT_EQ(b.rewards()[0], 0.f);
      EXPECT_FALSE(b.terminated()[0] || b.truncated()[0]);
    }
    ASSERT_EQ(now(a), now(b)) << i;
    ASSERT_EQ(now(a), now(c)) << i;
  }
  EXPECT_GT(ends, 3);
}

TEST_F(VectorSemantics, ASnapshotGoesOnInAnotherEnvOfAnotherBatch) {
  for (const Autoreset mode : {Autoreset::same_step, Autoreset::next_step, Autoreset::off}) {
    EnvConfig config = config_;
    config.autoreset = mode;
    BatchedEnv a = make(3, config), b = make(2, config);
    a.reset();
    b.reset();
    for (int i = 0; i < 20; ++i) {
      if (mode == Autoreset::off)
        for (int row = 0; row < 3; ++row)
          if (a.terminated()[static_cast<std::size_t>(row)] || a.truncated()[static_cast<std::size_t>(row)]) {
            std::vector<std::uint8_t> mask(3, 0);
            mask[static_cast<std::size_t>(row)] = 1;
            a.reset(mask);
          }
      step(a, i);
      b.restore(1, a.snapshot(2));
      for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
        ASSERT_EQ(row_of(a.rows(a.sensors()[sensor].name), 3, 2), row_of(b.rows(b.sensors()[sensor].name), 2, 1))
            << i << " " << a.sensors()[sensor].name;
      ASSERT_EQ(a.agent(2).episode_count, b.agent(1).episode_count);
    }
    if (mode == Autoreset::off) continue;
    for (int i = 20; i < 40; ++i) {
      a.step(std::vector<std::int32_t>{1, 1, test_action(5, i)});
      b.step(std::vector<std::int32_t>{2, test_action(5, i)});
      for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
        ASSERT_EQ(row_of(a.rows(a.sensors()[sensor].name), 3, 2), row_of(b.rows(b.sensors()[sensor].name), 2, 1))
            << i << " " << a.sensors()[sensor].name;
    }
    EXPECT_THROW(a.restore(0, "{}"), InputError);
    EXPECT_THROW(a.restore(0, a.save_state()), InputError);
  }
}

// Of an env whose episode was quarantined: what is restored from it says the same of itself, and begins the same episode.
TEST_F(VectorSemantics, ASnapshotOfAQuarantinedEpisodeIsRestoredAgainAndAgain) {
  for (const Autoreset mode : {Autoreset::next_step, Autoreset::off}) {
    EnvConfig config = config_;
    config.autoreset = mode;
    BatchedEnv a = make(2, config), b = make(2, config);
    a.set_stage_hook([](const StageOutput& output, std::span<float> values) {
      if (output.env == 1 && output.kind == Fault::spectrogram && output.step == 3) values[0] = std::nanf("");
    });
    a.reset();
    b.reset();
    for (int i = 0; i < 3; ++i) a.step(std::vector<std::int32_t>{1, 1});
    ASSERT_TRUE(a.quarantined()[1]);
    const std::string saved = a.snapshot(1);
    for (int again = 0; again < 3; ++again) {
      b.restore(1, b.snapshot(1));
      b.restore(1, saved);
      EXPECT_EQ(b.snapshot(1), saved) << again;
    }
    a.set_stage_hook({});
    const std::vector<std::uint8_t> second{0, 1};
    for (BatchedEnv* env : {&a, &b})
      if (mode == Autoreset::off)
        env->reset(second);
      else
        env->step(std::vector<std::int32_t>{1, 1});
    EXPECT_EQ(a.agent(1).episode_count, b.agent(1).episode_count);
    EXPECT_TRUE(b.active()[1]);
    for (std::size_t sensor = 0; sensor < a.sensors().size(); ++sensor)
      EXPECT_EQ(row_of(a.rows(a.sensors()[sensor].name), 2, 1), row_of(b.rows(b.sensors()[sensor].name), 2, 1)) << a.sensors()[sensor].name;
  }
}

TEST_F(VectorSemantics, WhatACallerCanGetWrongMovesNothing) {
  BatchedEnv env = make(3, config_);
  const std::vector<std::int32_t> one{1}, two{1, 1}, three{1, 1, 1};
  EXPECT_THROW(env.send(one, one), std::logic_error);  // before the first reset
  EXPECT_THROW(env.reset(std::vector<std::uint8_t>{1, 0, 1}), std::logic_error);
  env.reset();
  EXPECT_THROW(env.reset(std::vector<std::uint8_t>{1}), std::invalid_argument);
  EXPECT_THROW(env.reset(std::vector<std::uint8_t>{1, 1, 1}, std::vector<std::uint64_t>{1}), std::invalid_argument);
  EXPECT_THROW(env.recv(1), std::invalid_argument);  // none under way
  EXPECT_THROW(env.send(two, one), std::invalid_argument);
  EXPECT_THROW(env.send(two, two), std::logic_error);  // the same env twice
  EXPECT_THROW(env.send(std::vector<std::int32_t>{3}, one), std::out_of_range);
  EXPECT_THROW(env.send(std::vector<std::int32_t>{0, 1}, std::vector<std::int32_t>{1, 4}), std::invalid_argument);
  for (int row = 0; row < 3; ++row) EXPECT_EQ(env.agent(row).episode_step, 0);
  env.send(one, one);
  EXPECT_THROW(env.step(three), std::logic_error);
  EXPECT_THROW(env.reset(), std::logic_error);
  EXPECT_THROW(static_cast<void>(env.save_state()), std::logic_error);
  EXPECT_THROW(static_cast<void>(env.snapshot(1)), std::logic_error);
  EXPECT_THROW(env.send(one, one), std::logic_error);
  EXPECT_THAT(env.recv(1), testing::ElementsAre(1));
  env.step(three);
  EXPECT_EQ(env.agent(1).episode_step, 2);
  EXPECT_EQ(env.agent(0).episode_step, 1);
}

}  // namespace
}  // namespace earshot
