// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "envs/episodes/episode_generator.h"
#include "envs/task/av_nav_task.h"

namespace earshot {
namespace {

TEST(OracleSlow, ReachesItsGoalInFurnishedHouses) {
  const TaskConfig task;
  int episodes = 0, successes = 0;
  double spl = 0, lowest_spl = 1;
  for (int seed = 0; seed < 10; ++seed) {
    const std::string id = "house:" + std::to_string(seed);
    const Scene scene = load_scene(id);
    const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
    // Starts and goals that no oracle has chosen: the generator refuses episodes that its oracle cannot do.
    for (std::uint32_t draw = 0; draw < 20; ++draw) {
      const RandomStream random(17, Purpose::test, static_cast<std::uint32_t>(seed), draw);
      const glm::vec3 start = navmesh.random_point(random, 0), goal = navmesh.random_point(random, 2);
      const GeodesicField field(navmesh, goal);
      const auto distance_m = field.distance_m(start);
      if (!distance_m || *distance_m < 2.f) continue;
      AvNavState state;
      state.begin(task, field, start, random.uniform(4) * 6.28, 1);
      while (!state.terminated() && !state.truncated()) state.step(task, navmesh, field, oracle_action(task, field, state.pose(task)));
      const EpisodeMetrics m = state.metrics(task);
      ++episodes;
      successes += m.success > 0;
      spl += m.spl;
      if (m.success > 0)
        lowest_spl = std::min(lowest_spl, m.spl);
      else
        ADD_FAILURE_AT(__FILE__, __LINE__) << id << " draw " << draw << ": ended " << m.dtg_m << " m from the goal";
      EXPECT_EQ(state.lost_distances(), 0);
    }
  }
  RecordProperty("episodes", episodes);
  RecordProperty("mean_spl", std::to_string(spl / episodes));
  RecordProperty("lowest_spl", std::to_string(lowest_spl));
  EXPECT_GE(successes, 0.98 * episodes);
  EXPECT_GE(spl / episodes, 0.95);
}

}  // namespace
}  // namespace earshot
