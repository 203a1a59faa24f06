// SPDX-License-Identifier: Apache-2.0
#include "evaluation/leaderboard/leaderboard_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "evaluation/leaderboard/board_entry.h"
#include "evaluation/results/result_groups.h"
#include "evaluation/results/verify_result.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/random.h"
#include "tests/support/files/test_files.h"

namespace earshot {
namespace {

using testing::HasSubstr;
using testing::Not;

/// Ten scenes of ten episodes, of which so many of ten are a success.
EvaluationResult agent(const std::string& name, const std::vector<int>& hits_of_ten) {
  EvaluationResult result;
  result.agent = name;
  result.policy_hash = name;
  result.set_hash = "set";
  for (std::size_t scene = 0; scene < hits_of_ten.size(); ++scene)
    for (int i = 0; i < 10; ++i) {
      EpisodeMetrics metrics;
      metrics.success = i < hits_of_ten[scene] ? 1 : 0;
      metrics.spl = 0.9 * metrics.success;
      result.episodes.push_back({std::to_string(result.episodes.size()), "house:" + std::to_string(scene), metrics, {0}});
    }
  return result;
}

// Two samples of 100 with symmetric intervals of half widths a and b: half width sqrt(a^2 + b^2), the rule for variances; skew intervals
// give the nearer limits of each: worked by hand, 0.9 in [0.7, 0.95] less 0.6 in [0.5, 0.8] has 0.3 - sqrt(0.04 + 0.04) and 0.3 +
// sqrt(0.0025 + 0.01).
TEST(PrivateGap, IntervalsOfIndependentMeansAddUpAsVariancesDo) {
  const Estimate even = independent_difference({0.8, 0.77, 0.83}, {0.5, 0.46, 0.54});
  EXPECT_NEAR(even.mean, 0.3, 1e-12);
  EXPECT_NEAR(even.low, 0.25, 1e-12);
  EXPECT_NEAR(even.high, 0.35, 1e-12);
  const Estimate skew = independent_difference({0.9, 0.7, 0.95}, {0.6, 0.5, 0.8});
  EXPECT_NEAR(skew.low, 0.3 - std::sqrt(0.08), 1e-12);
  EXPECT_NEAR(skew.high, 0.3 + std::sqrt(0.0125), 1e-12);
}

// A policy that is as good on both sets is flagged in few of 300 pairs of sets (interval over scenes that differ: at most 2.5 % on the one
// side for each of two metrics, twice that with the error of 300 draws), one that is worse by 0.3 nearly always.
TEST(PrivateGap, FlagsWhatChanceDoesNotExplain) {
  const auto flagged = [](double less, std::uint32_t salt) {
    int count = 0;
    for (std::uint32_t sample = 0; sample < 300; ++sample) {
      const auto set = [&](std::uint32_t which, double chance) {
        const RandomStream random(7, Purpose::test, sample, which, salt);
        std::vector<int> hits;
        for (std::uint32_t scene = 0; scene < 10; ++scene) {
          const double scene_chance = chance + 0.2 * (static_cast<double>(random.uniform(1000 + scene)) - 0.5);
          int hit = 0;
          for (std::uint32_t i = 0; i < 10; ++i) hit += static_cast<double>(random.uniform(10 * scene + i)) < scene_chance ? 1 : 0;
          hits.push_back(hit);
        }
        return agent("a", hits);
      };
      count += private_scores({set(0, 0.8)}, {set(1, 0.8 - less)}).front().unexplained() ? 1 : 0;
    }
    return count;
  };
  EXPECT_LE(flagged(0, 1), 0.1 * 300);
  EXPECT_GE(flagged(0.3, 2), 0.9 * 300);
}

TEST(PrivateGap, PairsPoliciesByNameAndHash) {
  const EvaluationResult a = agent("a", {9, 9, 9, 9, 9}), b = agent("b", {9, 9, 9, 9, 9});
  EXPECT_EQ(private_scores({a, b}, {b}).front().agent, "b");
  EXPECT_THROW(private_scores({a}, {b}), InputError);
  EvaluationResult other = agent("a", {9, 9, 9, 9, 9});
  other.policy_hash = "another";
  EXPECT_THROW(private_scores({a}, {other}), InputError);
  EXPECT_THROW(private_scores({a}, {a, a}), InputError);  // which of them to show is not said
  EXPECT_THAT(private_text(private_scores({a}, {agent("a", {1, 1, 1, 1, 1})})), HasSubstr("significantly better on the public set"));
  EXPECT_THAT(private_text(private_scores({a}, {a})), Not(HasSubstr("significantly better")));
}

TEST(LeaderboardPage, SaysWhereActionsComeFrom) {
  std::vector<EvaluationResult> results{agent("seen", {9, 9, 9, 9, 9}), agent("run", {8, 8, 8, 8, 8}), agent("sent", {10, 10, 10, 10, 10})};
  const BoardPage page{.benchmark = "tiny 1"};
  const Evidence evidence[] = {Evidence::private_set, Evidence::run_by_board, Evidence::actions};
  EXPECT_THAT(leaderboard_page(results, page), Not(HasSubstr("actions alone")));
  for (std::size_t i = 0; i < results.size(); ++i) {
    results[i].standing = {.track = "ears", .rests_on = {}, .apart = {}};
    note_evidence(*results[i].standing, evidence[i]);
  }
  const std::string html = leaderboard_page(results, page);
  const auto row_of = [&](const std::string& name) {
    const std::size_t end = html.find("</tr>", html.find("<th scope=\"row\">" + name + "</th>"));
    return html.substr(html.rfind("<tr>", end), end - html.rfind("<tr>", end));
  };
  EXPECT_THAT(row_of("sent"), testing::AllOf(HasSubstr("<td>not ranked</td>"), HasSubstr("actions alone"), HasSubstr("<td>ears</td>")));
  EXPECT_THAT(row_of("run"), testing::AllOf(HasSubstr("<td>2</td>"), HasSubstr("run by the board")));
  EXPECT_THAT(row_of("seen"), testing::AllOf(HasSubstr("<td>1</td>"), HasSubstr("run by the board, on the private set too")));
  EXPECT_THAT(html, HasSubstr("sent is not ranked: its policy was not run by the board"));
  EXPECT_THAT(html, HasSubstr("<h1>Earshot leaderboard: tiny 1</h1>"));
}

TEST(LeaderboardPage, BreaksDownByWhatTheResultsHold) {
  EvaluationResult result = agent("<agent>", {10, 9, 8, 7, 6});
  EXPECT_THAT(leaderboard_page({result}, {}), HasSubstr("By scene"));
  for (const char* absent : {"By kind", "By size", "By geodesic distance", "By novelty"})
    EXPECT_THAT(leaderboard_page({result}, {}), Not(HasSubstr(absent)));
  for (std::size_t i = 0; i < result.episodes.size(); ++i) {
    auto& row = result.episodes[i];
    row.sound = i % 2 == 0 ? "synth:bird:1" : "synth:noise:1";
    row.area_m2 = 30 + static_cast<double>(i);            // 30 to 79: 20 episodes below 50 m2
    row.distance_m = 1 + static_cast<double>(i % 4) * 4;  // 1, 5, 9, 13
  }
  note_novelty(result, std::vector<std::string>{"synth:bird:1"});
  BoardPage page;
  page.replays["<agent>"] = {{"a_best.html", "best"}, {"a_worst.html", "worst"}};
  page.links = {{"curve.svg", "curve"}};
  const std::string html = leaderboard_page({result}, page);
  for (const char* present : {"By kind of sound, SPL", "By size of the scene, success", "By geodesic distance from start to goal, SPL",
                              "By novelty of the sound"})
    EXPECT_THAT(html, HasSubstr(present));
  for (const char* row :
       {"<th scope=\"row\">0 to 50 m2</th><td>20</td>", "<th scope=\"row\">50 to 100 m2</th><td>30</td>", "<th scope=\"row\">0 to 3 m</th>",
        "<th scope=\"row\">12 m and more</th>", "<th scope=\"row\">unheard kind</th><td>25</td>", "<th scope=\"row\">bird</th><td>25</td>"})
    EXPECT_THAT(html, HasSubstr(row));
  EXPECT_LT(html.find(">heard<"), html.find(">unheard kind<"));
  EXPECT_THAT(html, HasSubstr("<a href=\"a_best.html\">best</a>, <a href=\"a_worst.html\">worst</a>"));
  EXPECT_THAT(html, HasSubstr("<a href=\"curve.svg\">curve</a>"));
  EXPECT_THAT(html, Not(HasSubstr("<agent>")));
  EXPECT_THAT(html, Not(testing::ContainsRegex("<script|<link|<img|src=|https?:")));  // from disk, without a network
  EXPECT_THAT(groups_text({result}, GroupBy::size), HasSubstr("0 to 50 m2"));
}

TEST(ResultGroups, FloorsAreThoseOfTheRooms) {
  EXPECT_NEAR(floor_area_m2("house:2000,rooms=3,area_m2=36", ""), 36, 1e-6);
  const double drawn = floor_area_m2("house:40000", "");
  EXPECT_GE(drawn, 60);
  EXPECT_LE(drawn, 200);
  EXPECT_NEAR(floor_area_m2("shoebox:6x3x5@0.3", ""), 30, 1e-4);
}

TEST(ResultGroups, AFloorIsLoadedOnce) {
  const TempFolder folder;
  const std::string slab = folder.write("slab.obj", "v 0 0 0\nv 4 0 0\nv 0 0 5\nf 1 3 2\n");
  FloorAreas areas(folder / "");
  EXPECT_NEAR(areas.of("slab.obj"), 20, 1e-6);
  std::filesystem::remove(slab);
  EXPECT_NEAR(areas.of("slab.obj"), 20, 1e-6);
  EXPECT_THROW(areas.of("other.obj"), InputError);
}

/// A set of episodes in two rooms, in turn, with goals so far from their starts.
EpisodeSet set_of(const std::vector<float>& distances_m) {
  EpisodeSet set;
  for (const float distance_m : distances_m) {
    Episode episode;
    episode.episode_id = std::to_string(set.episodes.size());
    episode.scene_id = set.episodes.size() % 2 == 0 ? "shoebox:6x3x5@0.3" : "shoebox:4x3x5@0.3";
    episode.geodesic_distance_m = distance_m;
    set.episodes.push_back(std::move(episode));
  }
  set.hash = episode_set_hash(set.episodes);
  return set;
}

/// A result of the first so many episodes of a set.
EvaluationResult result_on(const EpisodeSet& set, std::size_t episodes) {
  EvaluationResult result;
  result.agent = "a";
  result.set_hash = set_hash_of_first(set, episodes);
  if (episodes < set.episodes.size()) result.partial_of = hex64(set.hash);
  for (std::size_t i = 0; i < episodes; ++i) result.episodes.push_back({set.episodes[i].episode_id, set.episodes[i].scene_id, {}, {0}});
  return result;
}

// Sets of the same scenes and names of episodes, made with other seeds, are told apart by their hashes.
TEST(ResultGroups, PlacesAreThoseOfTheResultsOwnSet) {
  const EpisodeSet set = set_of({2, 4, 8}), made_again = set_of({2, 4, 9});
  FloorAreas areas("");
  EvaluationResult whole = result_on(set, 3);
  ASSERT_TRUE(note_places(whole, set, areas));
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(whole.episodes[i].distance_m, static_cast<double>(set.episodes[i].geodesic_distance_m));
    EXPECT_NEAR(whole.episodes[i].area_m2, i % 2 == 0 ? 30 : 20, 1e-4);
  }
  EvaluationResult part = result_on(set, 2);
  ASSERT_TRUE(note_places(part, set, areas));
  EXPECT_EQ(part.episodes[1].distance_m, 4);

  const auto expect_nothing_noted = [&](EvaluationResult result, const EpisodeSet& other) {
    EXPECT_FALSE(note_places(result, other, areas));
    for (const auto& row : result.episodes) EXPECT_TRUE(row.distance_m == 0 && row.area_m2 == 0);
  };
  expect_nothing_noted(result_on(set, 3), made_again);
  expect_nothing_noted(result_on(set, 2), made_again);  // the first two are the same, the set that they are of is not
  expect_nothing_noted(result_on(set, 3), set_of({2, 4}));
}

}  // namespace
}  // namespace earshot
