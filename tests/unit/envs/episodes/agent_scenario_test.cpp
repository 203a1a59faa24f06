// SPDX-License-Identifier: Apache-2.0
#include "envs/episodes/agent_scenario.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <set>

#include "sim/base/errors.h"
#include "tests/support/envs/env_fixture.h"

namespace earshot {
namespace {

class AgentScenarios : public testing::Test {
 protected:
  static constexpr const char* kHouse = "house:2,rooms=2,area_m2=30";
  std::vector<Episode> episodes() {
    return generate_episodes(kHouse, scene_, navmesh_, {.filter = filter_, .sounds = {"synth:noise"}, .count = 20, .seed = 5});
  }
  const Scene scene_ = load_scene(kHouse);
  const Navmesh navmesh_{scene_.mesh(), NavmeshConfig{}};
  EpisodeRequest with_seed(std::uint64_t seed) const { return {.filter = filter_, .seed = seed}; }
  const EpisodeFilter filter_{.min_geodesic_m = 1, .max_geodesic_m = 100, .min_ratio = 0, .max_tries = 1000};
};

TEST_F(AgentScenarios, AsItStandsEpisodesStayAsTheyAre) {
  std::vector<Episode> all = episodes();
  const std::uint64_t before = episode_set_hash(all);
  apply_agents({}, scene_, navmesh_, with_seed(1), all);
  EXPECT_EQ(episode_set_hash(all), before);
}

TEST_F(AgentScenarios, StartsAreApartAndOnAPathToTheGoal) {
  std::vector<Episode> all = episodes(), again = all, other = all;
  const AgentScenario scenario{.count = 4, .apart_m = 0.8f, .sounds = {"synth:bird", "synth:alarm"}, .level_db = -3};
  apply_agents(scenario, scene_, navmesh_, with_seed(1), all);
  apply_agents(scenario, scene_, navmesh_, with_seed(1), again);
  apply_agents(scenario, scene_, navmesh_, with_seed(2), other);
  EXPECT_EQ(episode_set_hash(all), episode_set_hash(again));
  EXPECT_NE(episode_set_hash(all), episode_set_hash(other));
  std::set<std::string> sounds;
  for (const Episode& episode : all) {
    ASSERT_EQ(episode.other_agents.size(), 3u);
    std::vector<glm::dvec3> starts{episode.start_position};
    sounds.insert(episode.agent_sound);
    for (const EpisodeAgent& agent : episode.other_agents) {
      for (const glm::dvec3 start : starts) EXPECT_GE(glm::distance(start, agent.start_position), 0.8 - 1e-5);
      starts.push_back(agent.start_position);
      const auto path_m = navmesh_.path_length_m(scene_.to_local(agent.start_position), scene_.to_local(episode.goal_position));
      ASSERT_TRUE(path_m);
      EXPECT_GE(*path_m, 1.f - 1e-3f);
      EXPECT_EQ(agent.level_db, -3.f);
      sounds.insert(agent.sound);
    }
  }
  EXPECT_EQ(sounds, (std::set<std::string>{"synth:bird", "synth:alarm"}));
}

TEST_F(AgentScenarios, WhatCannotBeIsRefused) {
  std::vector<Episode> all = episodes();
  EXPECT_THROW(apply_agents({.count = 16, .apart_m = 5}, scene_, navmesh_, with_seed(1), all), InputError);
  EXPECT_THROW(apply_agents({.count = 17}, scene_, navmesh_, with_seed(1), all), InputError);
  EXPECT_THROW(validate(AgentScenario{.count = 1, .sounds = {"synth:bird"}}), InputError);
  EXPECT_THROW(validate(AgentScenario{.count = 2, .level_db = 3}), InputError);
}

}  // namespace
}  // namespace earshot
