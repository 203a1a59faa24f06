#include "trainer/result.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "trainer/leaderboard.h"

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
  const Estimate none = fraction_with_interval(0, 200);
  EXPECT_EQ(none.low, 0);
  EXPECT_NEAR(none.high, 0.0188454, 1e-6);
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
  EXPECT_THAT(leaderboard_html({other}), HasSubstr("&lt;b&gt;&amp;"));
}

}  // namespace
}  // namespace earshot
