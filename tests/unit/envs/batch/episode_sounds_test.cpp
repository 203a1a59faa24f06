// SPDX-License-Identifier: Apache-2.0
// Episodes with several sounds, sounds that begin and end, noise, several goals, and the grid.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/episode_refusal.h"

namespace earshot {
namespace {

constexpr const char* kRoom = "shoebox:8x3x6@0.4";
constexpr int kBlock = 2400;

Episode quiet_room() { return room_episode(kRoom, {1, 0, 1}, 0, {6, 0, 4}, "synth:noise"); }

class EpisodeSounds : public testing::Test {
 protected:
  static EnvConfig long_episodes() {
    EnvConfig config = quick_env_config();
    config.order = EpisodeOrder::once;
    config.task.max_steps = 100;
    config.observation.depth = false;
    return config;
  }
  /// What the ears hear along one walk, step by step, the first window first.
  std::vector<std::vector<float>> heard(const Episode& episode, int steps = 24) {
    BatchedEnv env(config_, make_set({episode}), scenes_, 1);
    env.reset();
    std::vector<std::vector<float>> blocks{{float_rows(env, "heard").begin(), float_rows(env, "heard").end()}};
    for (int i = 0; i < steps; ++i) {
      env.step(std::vector<std::int32_t>{i % 4 == 3 ? 2 : 1});
      blocks.emplace_back(float_rows(env, "waveform").begin(), float_rows(env, "waveform").end());
    }
    EXPECT_EQ(env.quarantine_counters().total(), 0u);
    return blocks;
  }
  static double energy(std::span<const float> block) {
    double sum = 0;
    for (const float sample : block) sum += static_cast<double>(sample) * static_cast<double>(sample);
    return sum;
  }
  EnvConfig config_ = long_episodes();
  std::shared_ptr<SceneCache> scenes_ = make_scene_cache(config_);
};

TEST_F(EpisodeSounds, SourcesAddUp) {
  Episode first_sound = quiet_room(), second_sound = first_sound, both_sounds = first_sound;
  const EpisodeSource goal{.position = {6, 0, 4}, .sound = "synth:noise", .onset_s = 0.2, .duration_s = 1.5, .goal = true, .level_db = -3};
  const EpisodeSource distractor{.position = {2, 0, 4.5}, .sound = "synth:telephone", .loop = false, .level_db = 6};
  first_sound.sources = {goal};
  second_sound.sources = {distractor};
  both_sounds.sources = {goal, distractor};
  const auto a = heard(first_sound), b = heard(second_sound), sum = heard(both_sounds);
  double largest = 0, worst = 0;
  for (std::size_t step = 0; step < sum.size(); ++step)
    for (std::size_t i = 0; i < sum[step].size(); ++i) {
      largest = std::max(largest, std::abs(static_cast<double>(sum[step][i])));
      worst =
          std::max(worst, std::abs(static_cast<double>(sum[step][i]) - static_cast<double>(a[step][i]) - static_cast<double>(b[step][i])));
    }
  EXPECT_GT(largest, 1e-3);
  EXPECT_LT(worst, 1e-6 * largest);
}

// From the onset on, and until the last echo (0.1 s) of the end is over.
TEST_F(EpisodeSounds, SoundBeginsAtItsOnsetAndEndsAfterItsDuration) {
  Episode episode = quiet_room();
  episode.sources = {{.position = {6, 0, 4}, .sound = "synth:noise", .onset_s = 0.4, .duration_s = 1.0, .goal = true}};
  const auto blocks = heard(episode);
  EXPECT_EQ(energy(blocks[0]), 0.0);
  for (std::size_t step = 1; step < blocks.size(); ++step) {
    const double from_s = 0.15 * static_cast<double>(step - 1), to_s = from_s + 0.15;
    const bool is_over = to_s <= 0.4 || from_s >= 1.4 + 0.15, sounds = from_s >= 0.45 && to_s <= 1.4;
    if (is_over) {
      EXPECT_EQ(energy(blocks[step]), 0.0) << step;
    } else if (sounds) {
      EXPECT_GT(energy(blocks[step]), 1e-4) << step;
    }
  }
}

TEST_F(EpisodeSounds, LevelsAreInDecibels) {
  Episode loud = quiet_room(), quiet = loud;
  loud.sources = {{.position = {6, 0, 4}, .sound = "synth:noise"}};
  quiet.sources = {{.position = {6, 0, 4}, .sound = "synth:noise", .level_db = -20}};
  const auto a = heard(loud, 6), b = heard(quiet, 6);
  EXPECT_NEAR(energy(a[6]) / energy(b[6]), 100.0, 0.01);
}

// Noise of the level of the goal's sound at 1 m less the signal-to-noise ratio, another at each ear, and the same for the same seed.
TEST_F(EpisodeSounds, NoiseHasTheRatioThatIsAskedFor) {
  Episode noisy = quiet_room();
  noisy.sources = {{.position = {6, 0, 4}, .sound = "synth:noise", .onset_s = 50, .goal = true}};
  noisy.noise_snr_db = 20.f;
  const SoundClip clip = synthesize_sound("synth:noise", 16000.f);
  const double rms_at_1_m = std::sqrt(energy(clip.samples) / static_cast<double>(clip.samples.size())) / (4 * std::numbers::pi);
  const auto blocks = heard(noisy, 20);
  double sum = 0, cross = 0;
  std::size_t count = 0;
  for (std::size_t step = 1; step < blocks.size(); ++step) {
    sum += energy(blocks[step]);
    count += blocks[step].size();
    for (std::size_t i = 0; i < kBlock; ++i) cross += static_cast<double>(blocks[step][i]) * static_cast<double>(blocks[step][kBlock + i]);
  }
  // 96,000 samples: the standard error of the mean square is sqrt(2 / n) = 0.5 %, that of the correlation 0.5 %.
  EXPECT_NEAR(std::sqrt(sum / static_cast<double>(count)) / (0.1 * rms_at_1_m), 1.0, 0.01);
  EXPECT_LT(std::abs(2 * cross / sum), 0.02);
  EXPECT_EQ(heard(noisy, 20), blocks);
}

// The free field: a source that moves away from 1 to 4 m within 1.5 s, and rests there.  The level falls by 20 log10 of the distance.
TEST_F(EpisodeSounds, AMovingSourceIsHeardFromWhereItIs) {
  config_.acoustics.early = config_.acoustics.late = config_.acoustics.diffraction = Switch::off;
  scenes_ = make_scene_cache(config_);
  Episode moving = room_episode(kRoom, {1, 0, 3}, 0, {6, 0, 4}, "synth:noise"), resting = moving;
  moving.sources = {{.position = {2, 0, 3}, .sound = "synth:noise", .path = {{0.3, {2, 0, 3}}, {1.8, {5, 0, 3}}}}};
  resting.sources = {{.position = {2, 0, 3}, .sound = "synth:noise", .path = {{0, {2, 0, 3}}}}};
  const auto stand = [&](const Episode& episode, int from, int to) {
    BatchedEnv env(config_, make_set({episode}), scenes_, 1);
    env.reset();
    double sum = 0;
    for (int i = 0; i < to; ++i) {
      env.step(std::vector<std::int32_t>{2});
      if (i >= from) sum += energy(float_rows(env, "waveform"));
    }
    return 10 * std::log10(sum);
  };
  // The agent turns alike in both.  Over 36 steps, five times the loop of the sound, what is 9 ms later is the same sound.
  EXPECT_NEAR(stand(moving, 0, 2) - stand(resting, 0, 2), 0, 0.1);  // before 0.3 s
  EXPECT_NEAR(stand(moving, 14, 50) - stand(resting, 14, 50), -20 * std::log10(4.0), 0.3);
}

// A turn to the left by a right angle before a source straight ahead: the step begins with equal ears, and ends with the level between
// them of an agent that has stood so.
TEST_F(EpisodeSounds, AStepLeadsFromThePoseBeforeToTheOneThatItIsGiven) {
  config_.acoustics.early = config_.acoustics.late = config_.acoustics.diffraction = Switch::off;
  config_.task.turn_deg = 90;
  scenes_ = make_scene_cache(config_);
  const auto right_over_left_db = [](std::span<const float> sound, std::size_t from, std::size_t count) {
    return 10 * std::log10(energy(sound.subspan(sound.size() / 2 + from, count)) / energy(sound.subspan(from, count)));
  };
  const auto facing = [&](double heading_rad) { return make_set({room_episode(kRoom, {4, 0, 5}, heading_rad, {4, 0, 1}, "synth:noise")}); };
  BatchedEnv standing(config_, facing(0.5 * std::numbers::pi), scenes_, 1), turning(config_, facing(0), scenes_, 1);
  standing.reset();
  const std::span<const float> before = float_rows(standing, "heard");
  const double expected_db = right_over_left_db(before, 0, before.size() / 2);
  ASSERT_GT(expected_db, 4) << "the test sees a step that is late";
  turning.reset();
  turning.step(std::vector<std::int32_t>{2});
  constexpr std::size_t part = kBlock / 10;
  EXPECT_NEAR(right_over_left_db(float_rows(turning, "waveform"), 0, kBlock / 40), 0, 1);
  EXPECT_NEAR(right_over_left_db(float_rows(turning, "waveform"), kBlock - part, part), expected_db, 1.5);
}

TEST_F(EpisodeSounds, ARestoredEnvGoesOnWithTheSameBits) {
  Episode episode = quiet_room();
  episode.sources = {{.position = {3, 0, 1}, .sound = "synth:music", .path = {{0.5, {3, 0, 1}}, {3.0, {3, 0, 4}}}},
                     {.position = {6, 0, 4}, .sound = "synth:noise", .onset_s = 0.5, .duration_s = 1.2, .goal = true},
                     {.position = {2, 0, 4.5}, .sound = "synth:speech:3", .onset_s = 1.0, .loop = false}};
  episode.noise_snr_db = 30.f;
  BatchedEnv env(config_, make_set({episode}), scenes_, 1);
  env.reset();
  for (int i = 0; i < 30; ++i) {
    BatchedEnv copy(config_, make_set({episode}), scenes_, 1);
    copy.restore(env.save_state());
    for (int ahead = 0; ahead < 2; ++ahead) {
      ASSERT_TRUE(std::ranges::equal(float_rows(env, "heard"), float_rows(copy, "heard"))) << i << " " << ahead;
      ASSERT_TRUE(std::ranges::equal(float_rows(env, "spectrogram"), float_rows(copy, "spectrogram"))) << i << " " << ahead;
      if (ahead == 0) {
        const std::vector<std::int32_t> action{i % 4 == 3 ? 2 : 1};
        env.step(action);
        copy.step(action);
      }
    }
  }
}

// Success when silent: the same stop counts after the end of the sound and not before.
TEST_F(EpisodeSounds, SuccessWhenSilentNeedsTheSoundToBeOver) {
  for (const double duration_s : {0.3, 5.0}) {
    Episode episode = room_episode(kRoom, {1, 0, 1}, 0, {1.3, 0, 1}, "synth:noise");
    episode.sources = {{.position = {1.3, 0, 1}, .sound = "synth:noise", .duration_s = duration_s, .goal = true}};
    BatchedEnv env(config_, make_set({episode}), scenes_, 1);
    env.reset();
    for (int i = 0; i < 4; ++i) env.step(std::vector<std::int32_t>{2});
    env.step(std::vector<std::int32_t>{0});
    ASSERT_EQ(env.finished().size(), 1u);
    EXPECT_EQ(env.finished()[0].metrics.success, 1.0);
    EXPECT_EQ(env.finished()[0].metrics.success_when_silent, duration_s < 0.5 ? 1.0 : 0.0);
  }
}

TEST_F(EpisodeSounds, TheNearestOfSeveralGoalsCounts) {
  Episode episode = room_episode(kRoom, {1, 0, 1}, 0, {6, 0, 4}, "synth:noise");
  episode.other_goals = {{1, 0, 3}, {7, 0, 1}};
  BatchedEnv env(config_, make_set({episode}), scenes_, 1);
  env.reset();
  EXPECT_NEAR(env.goal(0).distance_m({1, 0, 1}).value(), 2.0, 0.1);
  EXPECT_NEAR(env.goal(0).distance_m({6.9f, 0, 1}).value(), 0.1, 0.1);
  int steps = 0;
  while (env.active()[0] && steps++ < 90)
    env.step(std::vector<std::int32_t>{static_cast<std::int32_t>(oracle_action(config_.task, env.goal(0), env.agent(0).pose))});
  EXPECT_LT(steps, 45);  // 18 half turns and 1.5 m, not the 5.8 m to the first goal
  ASSERT_EQ(env.finished().size(), 1u);
  EXPECT_EQ(env.finished()[0].metrics.success, 1.0);
}

TEST_F(EpisodeSounds, OnTheGridAStepIsWholeOrNone) {
  config_.task.motion = Motion::grid;
  config_.task.forward_m = 1;
  config_.task.turn_deg = 90;
  BatchedEnv env(config_, make_set({room_episode(kRoom, {1, 0, 5}, 0, {6, 0, 4}, "synth:noise")}), scenes_, 1);
  env.reset();
  const glm::vec3 start = env.agent(0).pose.position;
  int forward = 0, blocked = 0;
  for (int i = 0; i < 40; ++i) {
    env.step(std::vector<std::int32_t>{i % 7 == 6 ? 3 : 1});
    const glm::vec3 moved = env.agent(0).pose.position - start;
    EXPECT_NEAR(moved.x, std::round(moved.x), 0.02 * (forward + 1));
    EXPECT_NEAR(moved.z, std::round(moved.z), 0.02 * (forward + 1));
    forward += env.collided()[0] == 0 && i % 7 != 6 ? 1 : 0;
    blocked += env.collided()[0];
  }
  EXPECT_GT(forward, 5);
  EXPECT_GT(blocked, 5);
}

TEST(EpisodeSet, SourcesAndGoalsAreReadAndWritten) {
  Episode episode = quiet_room();
  EXPECT_EQ(episode_set_text({episode}).find("sources"), std::string::npos);
  episode.sources = {
      {.position = {1, 2, 3}, .sound = "synth:bird", .onset_s = 2.5, .duration_s = 9, .loop = false, .goal = true, .level_db = -6},
      {.position = {4, 5, 6}, .sound = "a.wav", .path = {{1.5, {4, 5, 6}}, {2.5, {7, 5, 6}}}}};
  episode.other_goals = {{7, 8, 9}};
  episode.noise_snr_db = 12.5f;
  const EpisodeSet read = parse_episode_set(episode_set_text({episode}), "set");
  ASSERT_EQ(read.episodes.size(), 1u);
  EXPECT_EQ(read.episodes[0].sources, episode.sources);
  EXPECT_EQ(read.episodes[0].other_goals, episode.other_goals);
  EXPECT_EQ(read.episodes[0].noise_snr_db, episode.noise_snr_db);
  EXPECT_EQ(episode_set_hash(read.episodes), episode_set_hash({episode}));
  const auto refusal = [&](const std::string& from, const std::string& to) { return refusal_of_changed(episode, from, to); };
  EXPECT_THAT(refusal("\"onset_s\":2.5", "\"onset_s\":-1"), testing::HasSubstr("sources[0].onset_s"));
  EXPECT_THAT(refusal("\"onset_s\":2.5", "\"onset\":2.5"), testing::HasSubstr("sources[0].onset is not a key"));
  EXPECT_THAT(refusal("[2.5,7.0", "[1.5,7.0"), testing::HasSubstr("sources[1].path[1]"));
  EXPECT_THAT(refusal("\"loop\":false", "\"loop\":0"), testing::HasSubstr("true or false"));
  EXPECT_THAT(refusal("\"level_db\":-6.0", "\"level_db\":1e9"), testing::HasSubstr("level_db"));
}

}  // namespace
}  // namespace earshot
