// SPDX-License-Identifier: Apache-2.0
#include "envs/batch/batched_env.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "sim/base/errors.h"
#include "sim/vision/embree_camera.h"
#include "tests/support/envs/env_fixture.h"
#include "tests/support/envs/env_roll_out.h"

namespace earshot {
namespace {

using namespace roll_outs;

TEST(BatchedEnv, AnotherSeedGivesOtherEpisodes) {
  EnvConfig config = quick_env_config();
  const auto set = quick_set(3);
  const auto scenes = make_scene_cache(config);
  const auto reference = roll_out(config, set, scenes, {6}, 5);
  config.seed = 43;
  EXPECT_FALSE(roll_out(config, set, scenes, {6}, 5) == reference);
}

TEST(BatchedEnv, ARestoredBatchGoesOnWithTheSameBits) {
  EnvConfig config = quick_env_config();
  config.task.max_steps = 30;  // longer than the window of sound: the replay starts its sound in the middle
  const auto set = quick_set(3);
  const auto scenes = make_scene_cache(config);
  for (const int steps_before : {0, 4, 23}) {
    BatchedEnv original(config, set, scenes, 3, 2, 6), copy(config, set, scenes, 3, 2, 6);
    original.reset();
    for (int i = 0; i < steps_before; ++i) step(original, 2, i);
    const std::string state = original.save_state();
    copy.restore(state);
    EXPECT_EQ(copy.save_state(), state);
    for (const auto& [a, b] : {std::pair(float_rows(original, "depth"), float_rows(copy, "depth")),
                               std::pair(float_rows(original, "spectrogram"), float_rows(copy, "spectrogram")),
                               std::pair(float_rows(original, "heard"), float_rows(copy, "heard")),
                               std::pair(float_rows(original, "waveform"), float_rows(copy, "waveform")),
                               std::pair(float_rows(original, "pointgoal"), float_rows(copy, "pointgoal"))})
      EXPECT_TRUE(std::ranges::equal(a, b)) << steps_before << " steps before";
    std::map<int, std::vector<Record>> expected, got;
    for (int i = steps_before; i < steps_before + 15; ++i) {
      step(original, 2, i);
      step(copy, 2, i);
      for (int env = 0; env < 3; ++env) EXPECT_EQ(original.agent(env).episode_index, copy.agent(env).episode_index);
      EXPECT_TRUE(std::ranges::equal(float_rows(original, "depth"), float_rows(copy, "depth")));
      EXPECT_TRUE(std::ranges::equal(float_rows(original, "spectrogram"), float_rows(copy, "spectrogram")));
      EXPECT_TRUE(std::ranges::equal(original.rewards(), copy.rewards()));
      ASSERT_EQ(original.finished().size(), copy.finished().size());
      for (std::size_t k = 0; k < copy.finished().size(); ++k) {
        EXPECT_EQ(original.finished()[k].actions, copy.finished()[k].actions);
        EXPECT_EQ(original.finished()[k].metrics.reward, copy.finished()[k].metrics.reward);
      }
    }
  }
}

TEST(BatchedEnv, DamagedOrForeignStatesAreRefused) {
  EnvConfig config = quick_env_config();
  const auto set = quick_set(2);
  const auto scenes = make_scene_cache(config);
  BatchedEnv env(config, set, scenes, 2);
  env.reset();
  for (int i = 0; i < 3; ++i) env.step(std::vector<std::int32_t>{1, 2});
  const std::string state = env.save_state();
  EXPECT_NO_THROW(env.restore(state));
  EXPECT_THROW(env.restore(""), InputError);
  EXPECT_THROW(env.restore("{}"), InputError);
  for (std::size_t size = 0; size < state.size(); size += 7) EXPECT_THROW(env.restore(state.substr(0, size)), InputError);
  for (std::size_t at = 0; at < state.size(); ++at) {
    std::string damaged = state;
    damaged[at] = static_cast<char>(damaged[at] ^ 1);
    EXPECT_THROW(env.restore(damaged), InputError) << at;
  }
  BatchedEnv larger(config, set, scenes, 3), shifted(config, set, scenes, 2, 1, 3), other_set(config, quick_set(1), scenes, 2);
  EXPECT_THROW(larger.restore(state), InputError);
  EXPECT_THROW(shifted.restore(state), InputError);
  EXPECT_THROW(other_set.restore(state), InputError);
  config.seed = 1;
  BatchedEnv other_seed(config, set, scenes, 2);
  EXPECT_THROW(other_seed.restore(state), InputError);
}

TEST(BatchedEnv, OnceGivesEachEpisodeExactlyOnceThenIdles) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  config.task.max_steps = 2;
  const auto set = quick_set(3);  // 9 episodes
  const auto scenes = make_scene_cache(config);
  std::multiset<std::uint64_t> seen;
  for (const auto& [first, count] : {std::pair(0, 2), std::pair(2, 2)}) {  // two workers of two envs
    BatchedEnv env(config, set, scenes, count, first, 4);
    env.reset();
    for (int i = 0; i < 8; ++i) {
      env.step(std::vector<std::int32_t>{1, 1});
      for (const FinishedEpisode& end : env.finished()) {
        seen.insert(end.episode_index);
        EXPECT_EQ(end.episode_index % 4, static_cast<std::uint64_t>(end.env));
        EXPECT_EQ(end.actions, (std::vector<std::int8_t>{1, 1}));
      }
    }
    for (const std::uint8_t active : env.active()) EXPECT_EQ(active, 0);
    for (const float value : float_rows(env, "depth")) ASSERT_EQ(value, 0.f);
    for (const float value : float_rows(env, "heard")) ASSERT_EQ(value, 0.f);
    for (const float reward : env.rewards()) EXPECT_EQ(reward, 0.f);
    for (const std::uint8_t flag : env.truncated()) EXPECT_EQ(flag, 0);
    EXPECT_TRUE(env.finished().empty());
    BatchedEnv copy(config, set, scenes, count, first, 4);
    copy.restore(env.save_state());
    for (const std::uint8_t active : copy.active()) EXPECT_EQ(active, 0);
  }
  ASSERT_EQ(seen.size(), 9u);
  EXPECT_EQ(std::set<std::uint64_t>(seen.begin(), seen.end()).size(), 9u);
}

TEST(BatchedEnv, MoreEnvsThanEpisodesStartIdle) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  BatchedEnv env(config, make_set({room_episode("shoebox:6x3x5", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")}), make_scene_cache(config), 3);
  env.reset();
  EXPECT_THAT(env.active(), testing::ElementsAre(1, 0, 0));
  env.step(std::vector<std::int32_t>{0, 0, 0});
  EXPECT_THAT(env.terminated(), testing::ElementsAre(1, 0, 0));
  EXPECT_THAT(env.active(), testing::ElementsAre(0, 0, 0));
  EXPECT_EQ(env.finished().size(), 1u);
}

TEST(BatchedEnv, AnEndKeepsTheLastObservationAndShowsTheNextFirst) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  config.task.max_steps = 3;
  const std::string room = "shoebox:6x3x5@0.3";
  const auto set = make_set(
      {room_episode(room, {1, 0, 1}, -2.0, {5, 0, 4}, "synth:noise"), room_episode(room, {5, 0, 4}, 0.5, {1, 0, 1}, "synth:telephone")});
  BatchedEnv env(config, set, make_scene_cache(config), 1);
  env.reset();
  env.step(std::vector<std::int32_t>{1});
  env.step(std::vector<std::int32_t>{2});
  EXPECT_EQ(env.truncated()[0], 0);
  // The last action turns, so the pose of the end is known from the one before.
  Pose end = env.agent(0).pose;
  end.heading_rad += 10 * std::numbers::pi / 180;
  env.step(std::vector<std::int32_t>{2});
  EXPECT_EQ(env.truncated()[0], 1);
  EXPECT_EQ(env.terminated()[0], 0);
  ASSERT_EQ(env.finished().size(), 1u);
  EXPECT_EQ(env.finished()[0].metrics.steps, 3);
  EXPECT_EQ(env.finished()[0].episode_index, 0u);
  EXPECT_EQ(env.agent(0).episode_index, 1u);
  EXPECT_EQ(env.agent(0).episode_count, 1);
  EXPECT_EQ(env.agent(0).episode_step, 0);

  const EmbreeCamera camera(sensor_of(config.observation.camera));
  const Scene scene = load_scene(room);
  std::vector<float> picture(float_rows(env, "depth").size());
  camera.render(scene, nullptr, end, {.depth = picture});
  for (std::size_t i = 0; i < picture.size(); ++i) ASSERT_NEAR(final_float_rows(env, "depth")[i], picture[i], 1e-4f);
  camera.render(scene, nullptr, env.agent(0).pose, {.depth = picture});
  EXPECT_TRUE(std::ranges::equal(float_rows(env, "depth"), picture));
  // Position and direction of the second episode's goal by hand: 4 m in -x, 3 m in -z; atan2(4, 3) to the left of -z.
  EXPECT_NEAR(float_rows(env, "pointgoal")[0], 5.0f, 1e-3f);
  EXPECT_NEAR(float_rows(env, "pointgoal")[1], std::atan2(4.0, 3.0) - 0.5, 1e-3);
  EXPECT_NE(final_float_rows(env, "pointgoal")[0], float_rows(env, "pointgoal")[0]);
  EXPECT_FALSE(std::ranges::equal(final_float_rows(env, "spectrogram"), float_rows(env, "spectrogram")));
}

TEST(BatchedEnv, RewardsAddUpToTheEpisodesReward) {
  EnvConfig config = quick_env_config();
  const auto set = quick_set(2);
  BatchedEnv env(config, set, make_scene_cache(config), 2);
  env.reset();
  std::vector<double> sums(2, 0.0);
  int ends = 0;
  for (int i = 0; i < 40; ++i) {
    step(env, 0, i);
    for (std::size_t row = 0; row < 2; ++row) sums[row] += static_cast<double>(env.rewards()[row]);
    for (const FinishedEpisode& end : env.finished()) {
      const auto row = static_cast<std::size_t>(end.env);
      EXPECT_NEAR(end.metrics.reward, sums[row], 1e-9);
      EXPECT_EQ(end.metrics.steps, static_cast<int>(end.actions.size()));
      sums[row] = 0;
      ++ends;
    }
  }
  EXPECT_GE(ends, 4);
}

TEST(BatchedEnv, SoundIsContinuousAcrossSteps) {
  const EnvConfig config = quick_env_config();
  BatchedEnv env(config, quick_set(2), make_scene_cache(config), 2);
  env.reset();
  const std::size_t block = 2400, window = 16000;
  ASSERT_EQ(float_rows(env, "waveform").size(), 2 * 2 * block);
  ASSERT_EQ(float_rows(env, "heard").size(), 2 * 2 * window);
  std::vector<float> before(float_rows(env, "heard").begin(), float_rows(env, "heard").end());
  // Prefilled at the start: the sound has been playing.
  float loudest = 0;
  for (std::size_t i = 0; i < window / 4; ++i) loudest = std::max(loudest, std::abs(before[i]));
  EXPECT_GT(loudest, 0.f);
  for (int i = 0; i < 10; ++i) {
    step(env, 0, 100 + i);
    for (std::size_t row = 0; row < 2; ++row) {
      if (env.terminated()[row] || env.truncated()[row]) continue;
      for (std::size_t ear = 0; ear < 2; ++ear) {
        const auto now = float_rows(env, "heard").subspan((2 * row + ear) * window, window);
        const auto fresh = float_rows(env, "waveform").subspan((2 * row + ear) * block, block);
        const auto old = std::span(before).subspan((2 * row + ear) * window, window);
        ASSERT_TRUE(std::ranges::equal(now.first(window - block), old.subspan(block)));
        ASSERT_TRUE(std::ranges::equal(now.last(block), fresh));
      }
    }
    before.assign(float_rows(env, "heard").begin(), float_rows(env, "heard").end());
  }
}

TEST(BatchedEnv, SoundThatRestartsIsAFunctionOfTheStepsPosesAlone) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  const auto set = make_set({room_episode("shoebox:6x3x5@0.3", {2, 0, 2}, 0.3, {4, 0, 3.5}, "synth:speech:3")});
  // Turning forth and back: every second step has the same poses at both ends.
  const auto difference = [&](bool restarts) {
    config.sound_restarts = restarts;
    BatchedEnv env(config, set, make_scene_cache(config), 1);
    env.reset();
    std::vector<std::vector<float>> blocks;
    for (int i = 0; i < 6; ++i) {
      const auto action = static_cast<std::int32_t>(i % 2 == 0 ? Action::left : Action::right);
      env.step(std::span(&action, 1));
      blocks.emplace_back(float_rows(env, "waveform").begin(), float_rows(env, "waveform").end());
    }
    double largest = 0, loudest = 0;
    for (std::size_t i = 0; i < blocks[3].size(); ++i) {
      largest = std::max(largest, std::abs(double{blocks[3][i]} - double{blocks[5][i]}));
      loudest = std::max(loudest, std::abs(double{blocks[3][i]}));
    }
    EXPECT_GT(loudest, 0);
    return largest / loudest;
  };
  EXPECT_LT(difference(true), 1e-3);  // headings add up to the same but for rounding
  EXPECT_GT(difference(false), 0.1);  // another piece of the speech
}

double energy(std::span<const float> samples) {
  double sum = 0;
  for (const float x : samples) sum += static_cast<double>(x) * static_cast<double>(x);
  return sum;
}

/// A room that absorbs everything: direct sound only.
EnvConfig anechoic_config() {
  EnvConfig config = quick_env_config();
  config.acoustics.late = config.acoustics.early = Switch::off;
  config.order = EpisodeOrder::once;
  return config;
}

TEST(BatchedEnv, TheEarNearerToTheSourceIsLouder) {
  // Heading 0 looks along -z; the source stands 3 m to the left (-x), or to the right.
  const std::string room = "shoebox:10x3x10@1";
  for (const bool left : {true, false}) {
    const glm::vec3 goal = left ? glm::vec3(2, 0, 5) : glm::vec3(8, 0, 5);
    BatchedEnv env(anechoic_config(), make_set({room_episode(room, {5, 0, 5}, 0, goal, "synth:noise")}),
                   make_scene_cache(anechoic_config()), 1);
    env.reset();
    const double left_energy = energy(float_rows(env, "heard").first(16000)), right_energy = energy(float_rows(env, "heard").last(16000));
    // A head shadows the far ear by more than 3 dB over the band of the noise (Duda and Martens 1998: up to 20 dB at 4 kHz).
    EXPECT_GT((left ? left_energy : right_energy), 2 * (left ? right_energy : left_energy));
  }
}

TEST(BatchedEnv, DirectSoundFallsWithTheDistance) {
  EnvConfig config = anechoic_config();
  config.acoustics.air_absorption = Switch::off;
  const auto heard_energy = [&](float distance_m) {
    const auto set = make_set({room_episode("shoebox:10x3x10@1", {5, 0, 8}, 0, {5, 0, 8 - distance_m}, "synth:noise")});
    BatchedEnv env(config, set, make_scene_cache(config), 1);
    env.reset();
    return energy(float_rows(env, "heard"));
  };
  // Ears and source are level, so 3 m and 6 m are the paths, and energy falls as 1/r^2; nearer than that it is the head that makes a
  // difference (near_head.h).  The later arrival shifts 140 of 16000 samples out of the window: 3 % at most; a missing square would be a
  // factor 2.
  EXPECT_NEAR(heard_energy(3) / heard_energy(6), 4.0, 0.12);
}

TEST(BatchedEnv, SoundGainScalesTheSound) {
  const auto set = make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")});
  EnvConfig config = quick_env_config();
  BatchedEnv plain(config, set, make_scene_cache(config), 1);
  plain.reset();
  config.sound_gain = 4.f;  // a power of two: exact
  BatchedEnv loud(config, set, make_scene_cache(config), 1);
  loud.reset();
  for (std::size_t i = 0; i < float_rows(plain, "heard").size(); ++i)
    ASSERT_EQ(float_rows(loud, "heard")[i], 4.f * float_rows(plain, "heard")[i]);
}

TEST(BatchedEnv, LegacySpectrogramsHoldTheNewSamplesOnly) {
  EnvConfig config = quick_env_config();
  config.observation.legacy_spectrogram = true;
  const auto set = make_set({room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")});
  BatchedEnv env(config, set, make_scene_cache(config), 1);
  env.reset();
  env.step(std::vector<std::int32_t>{1});
  // 2400 samples reach frames whose window of 400 samples, centred at 160 f, begins before them: f <= 16, column 16 / 4 = 4.
  for (std::size_t row = 0; row < 65; ++row)
    for (std::size_t column = 5; column < 26; ++column)
      for (std::size_t ear = 0; ear < 2; ++ear) ASSERT_EQ(float_rows(env, "spectrogram")[(row * 26 + column) * 2 + ear], 0.f);
  float loudest = 0;
  for (const float value : float_rows(env, "spectrogram")) loudest = std::max(loudest, value);
  EXPECT_GT(loudest, 0.f);
}

// Every episode is too loud for a float: the run ends, and says so.  One among others: tests/robustness/quarantine_replay_test.cpp.
TEST(BatchedEnv, OverflowEverywhereStopsTheRun) {
  EnvConfig config = quick_env_config();
  config.sound_gain = 1e38f;  // finite sounds whose spectra are not
  for (const EpisodeOrder order : {EpisodeOrder::random, EpisodeOrder::once}) {
    config.order = order;
    BatchedEnv env(config, quick_set(1), make_scene_cache(config), 2);
    EXPECT_THROW(env.reset(), InputError);
    EXPECT_GT(env.quarantine_counters().nonfinite(), 0u);
    for (const auto rows :
         {float_rows(env, "spectrogram"), float_rows(env, "heard"), float_rows(env, "waveform"), float_rows(env, "depth"), env.rewards()})
      for (const float value : rows) ASSERT_TRUE(std::isfinite(value));
  }
}

TEST(BatchedEnv, EpisodesWithoutAPathArePassedOverOrCountAsFailed) {
  // The start lies outside of the room, where nothing can be walked on.
  auto bad = room_episode("shoebox:6x3x5@0.3", {60, 0, 1}, 0, {4, 0, 3}, "synth:noise");
  bad.episode_id = "lost";
  const auto good = room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise");
  EnvConfig config = quick_env_config();
  BatchedEnv env(config, make_set({bad, good}), make_scene_cache(config), 4);
  env.reset();
  for (int i = 0; i < 4; ++i) EXPECT_EQ(env.agent(i).episode_index, 1u);
  EXPECT_GT(env.quarantine_counters().of(Fault::path), 0u);

  config.order = EpisodeOrder::once;
  BatchedEnv once(config, make_set({bad, good}), make_scene_cache(config), 2);
  once.reset();
  EXPECT_THAT(once.active(), testing::ElementsAre(0, 1));
  once.step(std::vector<std::int32_t>{0, 0});
  ASSERT_EQ(once.finished().size(), 2u);
  for (const FinishedEpisode& end : once.finished()) {
    EXPECT_EQ(end.fault.has_value(), end.episode_index == 0);
    EXPECT_EQ(end.metrics.success, 0.0);
  }
  config.order = EpisodeOrder::random;
  BatchedEnv hopeless(config, make_set({bad}), make_scene_cache(config), 1);
  try {
    hopeless.reset();
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("'lost'"));
  }
}

TEST(BatchedEnv, MissingScenesAndSoundsAreNamed) {
  const EnvConfig config = quick_env_config();
  const auto no_sound = make_set({room_episode("shoebox:6x3x5", {1, 0, 1}, 0, {4, 0, 3}, "no_such_sound")});
  try {
    BatchedEnv env(config, no_sound, make_scene_cache(config), 1);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("no_such_sound"));
  }
  const auto no_scene = make_set({room_episode("no_such_scene.glb", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise")});
  BatchedEnv env(config, no_scene, make_scene_cache(config), 1);
  EXPECT_THROW(env.reset(), InputError);
}

TEST(BatchedEnv, ADeafAgentRendersNoSound) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = false;
  const auto set = make_set({room_episode("shoebox:6x3x5", {1, 0, 1}, 0, {4, 0, 3}, "no_such_sound")});  // never opened
  BatchedEnv env(config, set, make_scene_cache(config), 1);
  env.reset();
  env.step(std::vector<std::int32_t>{1});
  EXPECT_TRUE(float_rows(env, "spectrogram").empty() && float_rows(env, "heard").empty() && float_rows(env, "waveform").empty());
  BatchedEnv copy(config, set, make_scene_cache(config), 1);
  copy.restore(env.save_state());
  EXPECT_TRUE(std::ranges::equal(float_rows(copy, "depth"), float_rows(env, "depth")));
}

// One step in sixteen is timed and counts for all: of 32 envs over 16 steps each is timed once, so the sum is that of all in expectation.
// What the machine does to single steps must not matter: a factor of three covers it, and would not cover a forgotten weight.
TEST(BatchedEnv, StageSecondsAreThoseOfAllSteps) {
  const EnvConfig config = quick_env_config();
  BatchedEnv env(config, quick_set(1), make_scene_cache(config), 32);
  env.reset();
  const StageSeconds before = env.counters().stages;
  const auto sum = [](const StageSeconds& s) { return s.move + s.trace + s.synthesize + s.convolve + s.render + s.observe + s.reset; };
  EXPECT_GT(before.reset, 0.0);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 48; ++i) step(env, 0, i);
  const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const StageSeconds s = env.counters().stages;
  for (const double stage : {s.move, s.trace, s.synthesize, s.convolve, s.render, s.observe}) EXPECT_GT(stage, 0.0);
  EXPECT_LT(sum(s) - sum(before), 3 * wall_s);
  EXPECT_GT(sum(s) - sum(before), wall_s / 3);
}

}  // namespace
}  // namespace earshot
