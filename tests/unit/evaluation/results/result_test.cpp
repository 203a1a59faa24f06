// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/result.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "evaluation/leaderboard/leaderboard.h"
#include "evaluation/leaderboard/leaderboard_page.h"
#include "evaluation/results/result_groups.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

using testing::HasSubstr;

EvaluationResult agent(const std::string& name, int successes, int episodes, double spl) {
  EvaluationResult result;
  result.agent = name;
  result.set_hash = "set";
  result.engine_hash = "engine";
  for (int i = 0; i < episodes; ++i) {
    EpisodeMetrics metrics;
    metrics.success = i < successes ? 1 : 0;
    metrics.spl = spl * metrics.success;
    metrics.steps = 10 + i;
    result.episodes.push_back({std::to_string(i), "house:1", metrics, {1, 2, 0}});
  }
  return result;
}

// Values of the Wilson score interval as tabulated: 10 of 100 gives [0.05523, 0.17437], 0 of 200 gives [0, 0.01885].
TEST(Estimate, WilsonInterval) {
  const Estimate tenth = fraction_with_interval(10, 100);
  EXPECT_DOUBLE_EQ(tenth.mean, 0.1);
  EXPECT_NEAR(tenth.low, 0.0552291, 1e-6);
  EXPECT_NEAR(tenth.high, 0.1743657, 1e-6);
  const Estimate no_success = fraction_with_interval(0, 200);
  EXPECT_EQ(no_success.low, 0);
  EXPECT_NEAR(no_success.high, 0.0188454, 1e-6);
  EXPECT_EQ(fraction_with_interval(0, 0).high, 0);
}

// 1 ... 10: mean 5.5, standard deviation 3.02765, t(9) = 2.262157: half width 2.165850.  The expansion of t is good to 0.3 %.
TEST(Estimate, StudentInterval) {
  const Estimate e = mean_with_interval({1, 2, 3, 4, 5, 6, 7, 8, 9, 10});
  EXPECT_DOUBLE_EQ(e.mean, 5.5);
  EXPECT_NEAR(e.high - e.mean, 2.165850, 0.003 * 2.165850);
  EXPECT_NEAR(e.mean - e.low, e.high - e.mean, 1e-12);
  EXPECT_EQ(mean_with_interval({}).mean, 0);
  EXPECT_EQ(mean_with_interval({4}).low, 4);
}

// Groups whose members agree: the interval is that of the group means, whatever the number of members.  24 groups of values 0 and 1 have a
// deviation of 0.5: 1.96 * 0.5108 / sqrt(24) = 0.204 about the mean, the bootstrap's percentiles are known to about 0.015.
TEST(Estimate, IntervalOverGroupsDoesNotShrinkWithTheirSize) {
  for (const int members : {1, 40}) {
    std::vector<double> values;
    std::vector<int> groups;
    for (int group = 0; group < 24; ++group)
      for (int member = 0; member < members; ++member) {
        values.push_back(group % 2);
        groups.push_back(100 - group);
      }
    const Estimate e = mean_with_group_interval(values, groups);
    EXPECT_DOUBLE_EQ(e.mean, 0.5);
    EXPECT_NEAR(e.high - e.mean, 0.204, 0.025) << members;
    EXPECT_NEAR(e.mean - e.low, 0.204, 0.025) << members;
  }
}

// Draws of 12 houses with 10 episodes each, houses that differ: the interval holds the truth in about 95 % of 400 samples (standard error
// 1.1 %), where an interval over episodes that takes them as independent holds it far less often.
TEST(Estimate, IntervalOverGroupsHoldsTheTruth) {
  int held = 0, held_over_episodes = 0;
  for (std::uint32_t sample = 0; sample < 400; ++sample) {
    const RandomStream random(5, Purpose::test, sample);
    std::vector<double> values;
    std::vector<int> groups;
    for (int house = 0; house < 12; ++house) {
      const auto h = static_cast<std::uint32_t>(house);
      const float chance = 0.5f + 0.4f * (2 * random.uniform(1000 + h) - 1);
      for (std::uint32_t episode = 0; episode < 10; ++episode) {
        values.push_back(random.uniform(20 * h + episode) < chance ? 1 : 0);
        groups.push_back(house);
      }
    }
    const Estimate e = mean_with_group_interval(values, groups), naive = mean_with_interval(values);
    held += e.low <= 0.5 && 0.5 <= e.high;
    held_over_episodes += naive.low <= 0.5 && 0.5 <= naive.high;
  }
  EXPECT_GE(held, 0.90 * 400);
  EXPECT_LE(held, 0.99 * 400);
  EXPECT_LT(held_over_episodes, 0.90 * 400);
}

// Intervals over scenes that agree: never narrower than over episodes, never beyond what a metric can be.
TEST(EvaluationResult, IntervalsOverScenesStayWithinReason) {
  const auto result_of = [](const std::vector<int>& hits_of_ten) {
    EvaluationResult result;
    for (std::size_t scene = 0; scene < hits_of_ten.size(); ++scene)
      for (int i = 0; i < 10; ++i) {
        EpisodeMetrics metrics;
        metrics.success = metrics.spl = i < hits_of_ten[scene] ? 1 : 0;
        result.episodes.push_back({std::to_string(i), "house:" + std::to_string(scene), metrics, {}});
      }
    return result;
  };
  const EvaluationResult no_success = result_of(std::vector<int>(30, 0));
  ASSERT_TRUE(no_success.intervals_over_scenes());
  EXPECT_NEAR(no_success.success().high, fraction_with_interval(0, 300).high, 1e-12);
  const EvaluationResult equal = result_of({9, 9, 9, 9, 9});
  EXPECT_NEAR(equal.success().low, fraction_with_interval(45, 50).low, 1e-12);
  const EvaluationResult spread = result_of({10, 10, 10, 10, 5});
  EXPECT_LE(spread.success().high, 1);
  EXPECT_LE(spread.spl().high, 1);
  EXPECT_LT(spread.success().low, fraction_with_interval(45, 50).low);  // houses differ more than episodes would
}

TEST(ResultGroups, TellSoundsApartByWhatTheTrainingHeard) {
  EXPECT_EQ(sound_kind("synth:telephone:3"), "telephone");
  EXPECT_EQ(sound_kind("synth:bird"), "bird");
  EXPECT_EQ(sound_kind("sounds/bell.wav"), "recording");
  EvaluationResult result = agent("a", 2, 4, 0.5);
  const std::vector<std::string> sounds{"synth:bird:1", "synth:bird:7", "synth:noise:1", "bell.wav"};
  for (std::size_t i = 0; i < 4; ++i) result.episodes[i].sound = sounds[i];
  note_novelty(result, std::vector<std::string>{"synth:bird:0", "synth:bird:1", "synth:speech:0"});
  EXPECT_EQ(result.episodes[0].novelty, "heard");
  EXPECT_EQ(result.episodes[1].novelty, "unheard");
  EXPECT_EQ(result.episodes[2].novelty, "unheard kind");
  EXPECT_EQ(result.episodes[3].novelty, "unheard kind");
  const std::string text = groups_text({result}, GroupBy::novelty);
  EXPECT_THAT(text, HasSubstr("unheard kind                        2   50 %  0.000"));
  EXPECT_THAT(text, HasSubstr("unheard                             1   25 %  1.000"));
  EXPECT_THROW(groups_text({agent("old", 1, 2, 0.5)}, GroupBy::novelty), InputError);
}

TEST(EvaluationResult, FileRoundTrip) {
  const auto path = std::filesystem::temp_directory_path() / ("earshot_result_" + std::to_string(::getpid()) + ".json");
  const EvaluationResult written = agent("a", 3, 7, 0.5);
  save_result(written, path);
  const EvaluationResult read = load_result(path);
  ASSERT_EQ(read.episodes.size(), 7u);
  EXPECT_EQ(read.agent, "a");
  EXPECT_EQ(read.episodes[6].metrics.steps, 16);
  EXPECT_EQ(read.episodes[0].actions, (std::vector<std::int8_t>{1, 2, 0}));
  EXPECT_EQ(read.spl().mean, written.spl().mean);
  write_file_atomically(path, "{\"agent\": 3}");
  EXPECT_THROW(load_result(path), InputError);
  write_file_atomically(path, "not json");
  EXPECT_THROW(load_result(path), InputError);
  std::filesystem::remove(path);
  EXPECT_THROW(load_result(path), InputError);
}

TEST(Leaderboard, RanksBySplAndWarnsOfDifferentSets) {
  const auto rows = ranked({agent("slow", 5, 10, 0.2), agent("good", 5, 10, 0.9), agent("none", 0, 10, 0)});
  EXPECT_EQ(rows[0].agent, "good");
  EXPECT_EQ(rows[1].agent, "slow");
  EXPECT_EQ(rows[2].agent, "none");
  EXPECT_THAT(leaderboard_text(rows), HasSubstr("1     good"));
  EXPECT_THAT(leaderboard_text(rows), testing::Not(HasSubstr("note:")));

  EvaluationResult other = agent("other", 1, 10, 0.1);
  other.set_hash = "another";
  EXPECT_THAT(leaderboard_text({rows[0], other}), HasSubstr("different episode sets"));
  other.agent = "<b>&";
  EXPECT_THAT(leaderboard_page({other}, {}), HasSubstr("&lt;b&gt;&amp;"));
}

}  // namespace
}  // namespace earshot
