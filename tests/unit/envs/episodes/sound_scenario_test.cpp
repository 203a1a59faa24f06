// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/sound_scenario.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "sim/base/errors.h"
#include "tests/support/envs/env_fixture.h"

namespace earshot {
namespace {

const std::vector<std::string> kScenarioSounds = {"synth:bird", "synth:alarm", "synth:music"};
const std::vector<glm::dvec3> kPlaces = {{0, 0, 0}, {4, 0, 0}, {0, 0, 4}, {4, 0, 4}};

std::vector<Episode> episodes(std::size_t count) {
  std::vector<Episode> all(count, room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 4}, "synth:bird"));
  for (std::size_t i = 0; i < count; ++i) all[i].sound = kScenarioSounds[i % 3];
  return all;
}

TEST(SoundScenario, AsItStandsEpisodesStayAsTheyAre) {
  std::vector<Episode> all = episodes(3);
  const std::uint64_t before = episode_set_hash(all);
  EXPECT_FALSE(SoundScenario{}.changes_episodes());
  apply_scenario({}, kScenarioSounds, {}, 1, all);
  EXPECT_EQ(episode_set_hash(all), before);
}

// Onset uniform from 0 to 5 s: mean 2.5, standard error 1.443 / sqrt(n).  Duration normal (15, 9) with at least 1 s: P(N < 1) = 0.060,
// which raises the mean by 9 (phi(a) - a (1 - Phi(a))) = 0.22 with a = 14/9.
TEST(SoundScenario, OnsetsAndDurationsAreDrawnAsPublished) {
  constexpr std::size_t kCount = 4000;
  std::vector<Episode> all = episodes(kCount);
  apply_scenario({.onset_high_s = 5, .duration_mean_s = 15, .duration_std_s = 9}, kScenarioSounds, {}, 1, all);
  double onset = 0, duration = 0;
  std::size_t shortest = 0;
  for (const Episode& episode : all) {
    ASSERT_EQ(episode.sources.size(), 1u);
    const EpisodeSource& goal = episode.sources[0];
    EXPECT_TRUE(goal.goal && goal.loop && goal.sound == episode.sound && goal.position == episode.goal_position);
    ASSERT_TRUE(goal.onset_s >= 0 && goal.onset_s < 5 && goal.duration_s >= 1);
    onset += goal.onset_s / kCount;
    duration += goal.duration_s / kCount;
    shortest += goal.duration_s == 1.0 ? 1 : 0;
  }
  EXPECT_NEAR(onset, 2.5, 4 * 1.443 / std::sqrt(kCount));
  EXPECT_NEAR(duration, 15.22, 4 * 9 / std::sqrt(kCount));
  EXPECT_NEAR(static_cast<double>(shortest) / kCount, 0.060, 0.016);
}

TEST(SoundScenario, DistractorsPlayOtherSoundsElsewhere) {
  std::vector<Episode> all = episodes(60), again = episodes(60);
  const SoundScenario scenario{.distractors = 2, .distractor_level_db = -6, .noise_snr_db = 30};
  apply_scenario(scenario, kScenarioSounds, kPlaces, 1, all);
  std::set<double> places;
  for (const Episode& episode : all) {
    ASSERT_EQ(episode.sources.size(), 3u);
    EXPECT_EQ(episode.noise_snr_db, 30.f);
    for (std::size_t i = 1; i < 3; ++i) {
      EXPECT_FALSE(episode.sources[i].goal);
      EXPECT_EQ(episode.sources[i].level_db, -6.f);
      EXPECT_NE(episode.sources[i].sound, episode.sound);
      EXPECT_NE(episode.sources[i].position, episode.goal_position);
      places.insert(episode.sources[i].position.x + 10 * episode.sources[i].position.z);
    }
  }
  EXPECT_EQ(places.size(), 3u);
  apply_scenario(scenario, kScenarioSounds, kPlaces, 1, again);
  EXPECT_EQ(episode_set_hash(all), episode_set_hash(again));
  apply_scenario(scenario, kScenarioSounds, kPlaces, 2, again);
  EXPECT_NE(episode_set_hash(all), episode_set_hash(again));
  std::vector<Episode> single_source = episodes(1);
  EXPECT_THROW(apply_scenario(scenario, std::span(kScenarioSounds).first(1), kPlaces, 1, single_source), InputError);
  EXPECT_THROW(apply_scenario(scenario, kScenarioSounds, std::span(kPlaces).last(1), 1, single_source), InputError);
}

TEST(SoundScenario, RefusesWhatCannotBe) {
  for (const SoundScenario& wrong :
       {SoundScenario{.onset_low_s = 2, .onset_high_s = 1}, SoundScenario{.duration_std_s = 3}, SoundScenario{.distractors = -1},
        SoundScenario{.distractor_level_db = 3}, SoundScenario{.noise_snr_db = NAN}})
    EXPECT_THROW(validate(wrong), InputError);
}

}  // namespace
}  // namespace earshot
