// SPDX-License-Identifier: Apache-2.0
// Hard cases of episodes and of walking: islands, goals that cannot be, corners, resets without end.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <glm/geometric.hpp>
#include <numbers>
#include <sstream>

#include "envs/episodes/episode_set.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/base/errors.h"
#include "tests/support/envs/env_cases.h"
#include "tests/support/envs/nav_scenes.h"

namespace earshot {
namespace {

/// Two closed rooms ten metres apart, as an OBJ file: two islands.
std::string two_rooms_obj() {
  std::string second = room_obj(4, 3, 4), text = room_obj(6, 3, 5), moved;
  std::istringstream lines(second);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "v") {
      double x, y, z;
      words >> x >> y >> z;
      moved += "v " + std::to_string(x + 16) + " " + std::to_string(y) + " " + std::to_string(z) + "\n";
    } else {
      moved += "f";
      for (int corner; words >> corner;) moved += " " + std::to_string(corner + 8);
      moved += "\n";
    }
  }
  return text + moved;
}

class H62_GoalOnAnotherIsland : public testing::Test {
 protected:
  H62_GoalOnAnotherIsland() : folder_("islands"), mesh_((folder_.path() / "rooms.obj").string()) { write_text(mesh_, two_rooms_obj()); }
  TestFolder folder_;
  std::string mesh_;
};

TEST_F(H62_GoalOnAnotherIsland, HasNoDistanceAndIsNeverGenerated) {
  const Scene scene = load_scene(mesh_);
  const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
  EXPECT_EQ(navmesh.num_islands(), 2);
  const GeodesicField field(navmesh, {18, 0, 2});
  EXPECT_FALSE(field.distance_m({1, 0, 1}));
  EXPECT_FALSE(field.next_corner({1, 0, 1}));
  EXPECT_FALSE(navmesh.path_length_m({1, 0, 1}, {18, 0, 2}));
  EpisodeFilter filter;
  filter.min_geodesic_m = 1;
  filter.min_ratio = 0;
  for (const Episode& episode :
       generate_episodes(mesh_, scene, navmesh, {.filter = filter, .sounds = {"synth:noise"}, .count = 40, .seed = 3})) {
    EXPECT_TRUE(std::isfinite(episode.geodesic_distance_m));
    EXPECT_LT(episode.start_position.x, 6);  // the larger room
    EXPECT_LT(episode.goal_position.x, 6);
  }
}

TEST_F(H62_GoalOnAnotherIsland, IsQuarantinedAndSoundIsDefinedAllTheSame) {
  EnvConfig config = quick_env_config();
  config.quarantine_dir = (folder_.path() / "quarantine").string();
  const auto across = room_episode(mesh_, {1, 0, 1}, 0, {18, 0, 2}, "synth:noise");
  const auto inside = room_episode(mesh_, {1, 0, 1}, 0, {4, 0, 3}, "synth:noise");
  BatchedEnv env(config, make_set({across, inside}), make_scene_cache(config), 4);
  env.reset();
  for (int row = 0; row < 4; ++row) EXPECT_EQ(env.agent(row).episode_index, 1u);
  EXPECT_GT(env.quarantine_counters().of(Fault::path), 0u);
  EXPECT_EQ(env.quarantine_counters().files_written, 1u);
  EXPECT_TRUE(buffers_are_finite(env));
  // The response through two closed walls.
  const auto source = make_scene_cache(config)->source(mesh_, {18, 0, 2}, 1.5f);
  EnergyResponse response;
  compute_energy_response(source->scene->acoustics, source->candidates, {1, 1.5f, 1}, response);
  for (const float value : response.late.values()) ASSERT_TRUE(std::isfinite(value));
  for (const Arrival& arrival : response.arrivals) ASSERT_TRUE(std::isfinite(arrival.distance_m));
}

TEST(H63_BadStartsAndGoals, AreRejectedInSetsAndQuarantinedInRuns) {
  // A set that says so is refused whole, with the episode's name.
  const auto text = [](const std::string& distance) {
    return R"({"episodes":[{"episode_id":"7","scene_id":"shoebox:6x3x5","start_position":[1,0,1],"start_rotation":[0,0,0,1],"goals":[{"position":[1,0,1]}],)"
           R"("info":{"geodesic_distance":)" +
           distance + R"(,"num_action":1,"sound":"synth:noise"}}]})";
  };
  for (const std::string distance : {"0", "-1", "1e999", "null", "NaN", "Infinity"}) {
    try {
      parse_episode_set(text(distance), "set.json");
      FAIL() << distance;
    } catch (const InputError&) {
    }
  }
  // Starts that only the scene can refuse: outside, high above the floor, nowhere.
  auto bad = room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise");
  std::vector<Episode> episodes;
  for (const glm::dvec3 start : {glm::dvec3(60, 0, 1), glm::dvec3(1, 40, 1), glm::dvec3(1, 0, -3), glm::dvec3(1e30, 0, 1)}) {
    episodes.push_back(bad);
    episodes.back().start_position = start;
    episodes.back().episode_id = "bad " + std::to_string(episodes.size());
  }
  for (const glm::dvec3 goal : {glm::dvec3(60, 0, 1), glm::dvec3(1e30, 0, 1)}) {
    episodes.push_back(bad);
    episodes.back().goal_position = goal;
  }
  episodes.push_back(bad);
  episodes.back().start_rotation = {0, 0, 0, 0};
  const std::size_t count = episodes.size();
  episodes.push_back(room_episode("shoebox:6x3x5@0.3", {1, 0, 1}, 0, {4, 0, 3}, "synth:noise"));
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  BatchedEnv env(config, make_set(episodes), make_scene_cache(config), 1);
  env.reset();
  EXPECT_EQ(env.agent(0).episode_index, count);
  EXPECT_EQ(env.quarantine_counters().total(), count);
  env.step(std::vector<std::int32_t>{0});
  ASSERT_EQ(env.finished().size(), count + 1);
  for (const FinishedEpisode& end : env.finished()) EXPECT_EQ(end.fault.has_value(), end.episode_index < count);
  EXPECT_TRUE(buffers_are_finite(env));
}

TEST(H63_BadStartsAndGoals, StopAtTheGoalIsASuccess) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  // The goal under the agent's feet: the distance is zero, the source is at its ears.
  const auto set = make_set({room_episode("shoebox:6x3x5@0.3", {2, 0, 2}, 0, {2, 0, 2}, "synth:noise")});
  BatchedEnv env(config, set, make_scene_cache(config), 1);
  env.reset();
  EXPECT_TRUE(buffers_are_finite(env));
  env.step(std::vector<std::int32_t>{0});
  ASSERT_EQ(env.finished().size(), 1u);
  EXPECT_FALSE(env.finished()[0].fault);
  EXPECT_EQ(env.finished()[0].metrics.success, 1.0);
  EXPECT_EQ(env.finished()[0].metrics.spl, 1.0);
  EXPECT_EQ(env.finished()[0].metrics.sna, 1.0);
}

// An obstacle higher than the agent, whose inside Recast takes for floor: no episode starts in it.
TEST(H63_BadStartsAndGoals, NobodyStartsInsideAnObstacle) {
  TriangleMesh mesh = floor_with(8, 6, {});
  append_block(mesh, 3, 2, 5, 4, 1.8f);
  const Scene scene("obstacle", mesh, std::vector<Material>(mesh.material_names.size()), Air{});
  const Navmesh navmesh(scene.mesh(), NavmeshConfig{});
  EpisodeFilter filter;
  filter.min_geodesic_m = 0.5f;
  filter.min_ratio = 0;
  for (const Episode& episode :
       generate_episodes("obstacle", scene, navmesh, {.filter = filter, .sounds = {"synth:noise"}, .count = 60, .seed = 5}))
    for (const glm::dvec3 point : {episode.start_position, episode.goal_position})
      EXPECT_FALSE(point.x > 3 && point.x < 5 && point.z > 2 && point.z < 4) << point.x << " " << point.z;
}

// Five hundred steps against a corner: the pose keeps its bits, no response is worked out anew, and the sound goes on.
TEST(H64_StuckInACorner, HearsOnWithoutNewResponses) {
  EnvConfig config = quick_env_config();
  config.order = EpisodeOrder::once;
  config.task.max_steps = 600;
  const auto set =
      make_set({room_episode("shoebox:6x3x5@0.3", {0.5, 0, 0.5}, std::numbers::pi / 4, {4, 0, 3}, "synth:noise")});  // looks along -x -z
  BatchedEnv env(config, set, make_scene_cache(config), 1);
  env.reset();
  for (int step = 0; step < 20; ++step) env.step(std::vector<std::int32_t>{1});
  const Pose stuck = env.agent(0).pose;
  const std::uint64_t cached = env.counters().cached_responses;
  std::vector<float> heard(float_rows(env, "heard").begin(), float_rows(env, "heard").end());
  const std::vector<float> picture(float_rows(env, "depth").begin(), float_rows(env, "depth").end());
  for (int step = 0; step < 500; ++step) {
    env.step(std::vector<std::int32_t>{1});
    ASSERT_EQ(env.agent(0).pose.position, stuck.position) << step;
    ASSERT_EQ(env.agent(0).pose.heading_rad, stuck.heading_rad);
    ASSERT_EQ(env.collided()[0], 1);
    ASSERT_FLOAT_EQ(env.rewards()[0], -0.01f);
    // One step of new sound behind what was heard before.
    const std::size_t window = heard.size() / 2, block = float_rows(env, "waveform").size() / 2;
    for (std::size_t ear = 0; ear < 2; ++ear) {
      const auto now = float_rows(env, "heard").subspan(ear * window, window);
      ASSERT_TRUE(std::ranges::equal(now.first(window - block), std::span(heard).subspan(ear * window + block, window - block)));
      ASSERT_TRUE(std::ranges::equal(now.last(block), float_rows(env, "waveform").subspan(ear * block, block)));
    }
    heard.assign(float_rows(env, "heard").begin(), float_rows(env, "heard").end());
  }
  EXPECT_EQ(env.counters().cached_responses - cached, 500u);
  EXPECT_TRUE(std::ranges::equal(float_rows(env, "depth"), picture));
  float loudest = 0;
  for (const float value : float_rows(env, "waveform")) loudest = std::max(loudest, std::abs(value));
  EXPECT_GT(loudest, 0.f);
}

TEST(X_TenThousandResets, StayFiniteAndKeepTheMemory) {
  EnvConfig config = quick_env_config();
  config.observation.spectrogram = false;
  BatchedEnv env(config, quick_set(3), make_scene_cache(config), 1);
  double warm_mib = 0;
  env.reset();
  const std::vector<float> first = shown_by(env, 0);
#ifdef EARSHOT_SANITIZED
  constexpr int kResets = 500;  // they keep freed memory, so the test says nothing there, and are twenty times slower
#else
  constexpr int kResets = 10000;
#endif
  for (int i = 0; i < kResets; ++i) {
    if (i == 1000) warm_mib = resident_mib();
    if (i % 2 == 0) {
      env.reset();
      ASSERT_EQ(shown_by(env, 0), first);  // always the same first episode
    } else {
      env.step(std::vector<std::int32_t>{0});  // stop: the env begins its second
      ASSERT_TRUE(buffers_are_finite(env));
    }
  }
  if (kResets > 1000) {
    EXPECT_LT(resident_mib() - warm_mib, 8.0);
  }
  EXPECT_EQ(env.quarantine_counters().total(), 0u);
}

// Distances against the straight line in long double, over a floor of 40 m.
TEST(Precision, GeodesicDistancesAreExactToMillimetres) {
  const Navmesh navmesh(floor_with(40, 4, {}), {});
  double worst_m = 0;
  for (int i = 0; i < 200; ++i) {
    const glm::vec3 goal{39, 0, 2}, from{0.5f + 0.19f * static_cast<float>(i), 0, 1.f + 0.01f * static_cast<float>(i)};
    const GeodesicField field(navmesh, goal);
    const auto distance_m = field.distance_m(from);
    ASSERT_TRUE(distance_m);
    const long double dx = static_cast<long double>(goal.x) - from.x, dz = static_cast<long double>(goal.z) - from.z;
    worst_m = std::max(worst_m, static_cast<double>(std::abs(static_cast<long double>(*distance_m) - std::sqrt(dx * dx + dz * dz))));
  }
  std::printf("geodesic distances of up to 38 m: at most %.1e m off\n", worst_m);
  EXPECT_LT(worst_m, 2.1e-4);  // both ends may stand 0.1 mm off a wall; a float at 38 m has steps of 3.8e-6
}

// The rewards of a long walk add up to the distance walked toward the goal: differences of floats of 38 m do not pile up.
TEST(Precision, RewardsOfALongWalkAddUp) {
  TaskConfig task;
  task.max_steps = 1000;
  const Navmesh navmesh(floor_with(40, 4, {}), {});
  const GeodesicField field(navmesh, {39, 0, 2});
  AvNavState state;
  state.begin(task, field, *navmesh.snap({1, 0, 2}), -std::numbers::pi / 2, 10);
  const double start_m = static_cast<double>(state.distance_to_goal_m());
  double sum = 0;
  for (int step = 0; step < 200; ++step) sum += static_cast<double>(state.step(task, navmesh, field, Action::forward)) + 0.01;
  const double covered_m = start_m - static_cast<double>(state.distance_to_goal_m());
  std::printf("200 rewards of a walk of %.3f m: %.1e m off\n", covered_m, std::abs(sum - covered_m));
  EXPECT_NEAR(covered_m, 30.0, 1e-3);
  EXPECT_NEAR(sum, covered_m, 200 * 4e-6);
}

}  // namespace
}  // namespace earshot
