// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/episode_generator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

const std::vector<std::string> kSounds = {"synth:telephone", "synth:alarm", "synth:music"};

struct World {
  explicit World(const std::string& spec) : id(spec), scene(load_scene(spec)), navmesh(scene.mesh(), NavmeshConfig{}) {}
  std::vector<Episode> generate(int count, std::uint64_t seed, EpisodeFilter filter = {}, int num_goals = 0) const {
    return generate_episodes(id, scene, navmesh,
                             {.filter = filter, .sounds = kSounds, .count = count, .seed = seed, .num_goals = num_goals});
  }
  std::vector<glm::vec3> goals(int count, std::uint64_t seed) const {
    return spread_goals(id, scene, navmesh, {.seed = seed, .num_goals = count});
  }
  std::string id;
  Scene scene;
  Navmesh navmesh;
};

const World& house() {
  static const World world("house:3,rooms=4");
  return world;
}

bool same(const Episode& a, const Episode& b) {
  return a.episode_id == b.episode_id && a.scene_id == b.scene_id && a.start_position == b.start_position &&
         a.start_rotation == b.start_rotation && a.goal_position == b.goal_position && a.geodesic_distance_m == b.geodesic_distance_m &&
         a.num_action == b.num_action && a.sound == b.sound;
}

TEST(EpisodeGenerator, EpisodesPassTheFilterAndCanBeWalked) {
  const EpisodeFilter filter;
  const TaskConfig task;
  for (const Episode& episode : house().generate(20, 1)) {
    const auto path_m = house().navmesh.path_length_m(episode.start_position, episode.goal_position);
    ASSERT_TRUE(path_m);
    // Two algorithms for the same path: a field from the goal and a query between the two.
    EXPECT_NEAR(*path_m, episode.geodesic_distance_m, 0.02f * *path_m + 0.05f);
    const double straight_m = glm::length(episode.goal_position - episode.start_position);
    EXPECT_GE(episode.geodesic_distance_m, filter.min_geodesic_m);
    EXPECT_GE(episode.geodesic_distance_m, filter.min_ratio * straight_m);
    // An agent of 0.15 m steps cannot need fewer; success is within 1 m, the oracle goes to 0.5 m.
    EXPECT_GE(episode.num_action, static_cast<int>((episode.geodesic_distance_m - 0.5f) / task.forward_m));
    EXPECT_LE(episode.num_action, task.max_steps);
    EXPECT_EQ(episode.scene_id, "house:3,rooms=4");
    EXPECT_THAT(kSounds, testing::Contains(episode.sound));
    const double turns = heading_of(episode.start_rotation) / (10 * std::numbers::pi / 180);
    EXPECT_NEAR(turns, std::round(turns), 1e-5);
  }
}

TEST(EpisodeGenerator, AirAboveStartAndGoalIsFree) {
  for (const Episode& episode : house().generate(20, 2))
    for (const glm::vec3 foot : {episode.start_position, episode.goal_position})
      EXPECT_FALSE(house().scene.rays().occluded(foot + glm::vec3(0, 0.3f, 0), foot + glm::vec3(0, 1.5f, 0)));
}

TEST(EpisodeGenerator, SameSeedSameEpisodesAndAPrefixStaysAPrefix) {
  const auto first = house().generate(12, 5), again = house().generate(12, 5), fewer = house().generate(5, 5),
             other = house().generate(12, 6);
  int equal_to_other = 0;
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_TRUE(same(first[i], again[i]));
    EXPECT_TRUE(i >= fewer.size() || same(first[i], fewer[i]));
    equal_to_other += same(first[i], other[i]);
  }
  EXPECT_EQ(equal_to_other, 0);
}

TEST(EpisodeGenerator, StartsAreUniformOverTheFloor) {
  // An empty room of 12 x 12 m: chi-square over 4 quadrants, 3 degrees of freedom; 16.3 is exceeded once in a thousand seeds.
  const World world("shoebox:12x3x12");
  EpisodeFilter filter;
  filter.min_geodesic_m = 0.5f;
  filter.min_ratio = 0.f;
  std::map<int, int> starts, goals, sounds;
  const int count = 200;
  for (const Episode& episode : world.generate(count, 9, filter)) {
    ++starts[(episode.start_position.x > 6 ? 1 : 0) + (episode.start_position.z > 6 ? 2 : 0)];
    ++goals[(episode.goal_position.x > 6 ? 1 : 0) + (episode.goal_position.z > 6 ? 2 : 0)];
    ++sounds[static_cast<int>(std::find(kSounds.begin(), kSounds.end(), episode.sound) - kSounds.begin())];
  }
  for (const auto& [counts, cells] : {std::pair(starts, 4), std::pair(goals, 4), std::pair(sounds, 3)}) {
    double chi_square = 0;
    const double expected = static_cast<double>(count) / cells;
    for (int cell = 0; cell < cells; ++cell) {
      const double n = counts.contains(cell) ? counts.at(cell) : 0;
      chi_square += (n - expected) * (n - expected) / expected;
    }
    EXPECT_LT(chi_square, 16.3);
  }
}

TEST(EpisodeGenerator, SharedGoalsAreFewFreeAndFarApart) {
  const World& world = house();
  const auto goals = world.goals(10, 4);
  ASSERT_EQ(goals.size(), 10u);
  // The closest two of ten uniform places of A m2 lie about sqrt(A) / (2 * 9.5) apart (mean over pairs of exponential areas), and hardly
  // ever over twice that; of a spread set they are near sqrt(A / 10) / 2.
  float closest_m = 1e9f;
  for (std::size_t i = 0; i < goals.size(); ++i) {
    EXPECT_FALSE(world.scene.rays().occluded(goals[i] + glm::vec3(0, 0.3f, 0), goals[i] + glm::vec3(0, 1.5f, 0)));
    for (std::size_t j = 0; j < i; ++j) closest_m = std::min(closest_m, glm::length(goals[i] - goals[j]));
  }
  EXPECT_GT(closest_m, 2.f * std::sqrt(world.navmesh.main_area_m2()) / 19.f);
  // The first goals do not depend on the number of goals.
  const auto fewer = world.goals(4, 4);
  EXPECT_TRUE(std::equal(fewer.begin(), fewer.end(), goals.begin()));
  EXPECT_NE(world.goals(1, 5)[0], goals[0]);

  const EpisodeFilter filter;
  std::map<std::size_t, int> used;
  for (const Episode& episode : world.generate(60, 4, filter, 10)) {
    const auto found = std::find(goals.begin(), goals.end(), glm::vec3(episode.goal_position));
    ASSERT_NE(found, goals.end());
    ++used[static_cast<std::size_t>(found - goals.begin())];
    const auto path_m = world.navmesh.path_length_m(episode.start_position, episode.goal_position);
    ASSERT_TRUE(path_m);
    EXPECT_NEAR(*path_m, episode.geodesic_distance_m, 0.02f * *path_m + 0.05f);
    EXPECT_GE(episode.geodesic_distance_m, filter.min_geodesic_m);
  }
  EXPECT_GE(used.size(), 5u);  // those in the middle of the house may be too near to everywhere
}

TEST(EpisodeGenerator, SharedGoalsKeepAPrefixAndTheirSeed) {
  const auto first = house().generate(12, 5, {}, 6), again = house().generate(12, 5, {}, 6), fewer = house().generate(5, 5, {}, 6);
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_TRUE(same(first[i], again[i]));
    EXPECT_TRUE(i >= fewer.size() || same(first[i], fewer[i]));
  }
  EXPECT_THROW(house().generate(1, 1, {}, -1), InputError);
}

TEST(EpisodeGenerator, ImpossibleFiltersAndEmptyListsAreRefused) {
  EpisodeFilter far;
  far.min_geodesic_m = 90;
  far.max_tries = 20;
  EXPECT_THROW(house().generate(1, 1, far), InputError);
  EXPECT_THROW(generate_episodes("x", house().scene, house().navmesh, {.count = 1}), InputError);
  EpisodeFilter wrong;
  wrong.max_geodesic_m = 1;
  EXPECT_THROW(validate(wrong), InputError);
  wrong = {};
  wrong.min_ratio = NAN;
  EXPECT_THROW(validate(wrong), InputError);
  EXPECT_TRUE(house().generate(0, 1).empty());
}

}  // namespace
}  // namespace earshot
