// SPDX-License-Identifier: Apache-2.0
#include "evaluation/results/split_overlap.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sim/scene/scene.h"
#include "tests/support/envs/env_cases.h"

namespace earshot {
namespace {

using Names = std::vector<std::string>;

TEST(SplitOverlap, FindsScenesByNameAndByGeometry) {
  const TestFolder folder("split_overlap");
  write_text(folder.path() / "room.obj", room_obj(6, 3, 5));
  const std::string copy = (folder.path() / "room.obj").string();
  const auto find = [](const Names& trained, const Names& tested) { return find_scene_overlap(trained, tested, ""); };
  EXPECT_FALSE(find({"house:1", "house:2"}, {"house:3", "shoebox:6x3x5@0.3"}));
  const auto seed = find({"house:1", "house:2,rooms=3"}, {"house:3", "house:2,rooms=4"});
  ASSERT_TRUE(seed);
  EXPECT_EQ(seed->tested, "house:2,rooms=4");
  EXPECT_EQ(seed->trained, "house:2,rooms=3");
  const auto geometry = find({"house:1", "shoebox:6x3x5@0.3"}, {"house:3", copy});
  ASSERT_TRUE(geometry);
  EXPECT_EQ(geometry->tested, copy);
  EXPECT_EQ(geometry->why, "a near-duplicate of");
}

// A house moved by 3 m and jittered by 1 mm stays it: of its corners those within 1 mm of a border of cells are lost, at most 3 * 2 * 1 mm
// / 50 mm and as much of the copy.  Other seeds are others: twelve houses, all pairs.
TEST(SplitOverlap, GeometryTellsCopiesFromOtherHouses) {
  std::vector<Scene> houses;
  for (int seed = 0; seed < 12; ++seed) houses.push_back(load_scene("house:" + std::to_string(seed) + ",rooms=3,area_m2=36"));
  double most = 0;
  for (std::size_t i = 0; i < houses.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) most = std::max(most, geometry_overlap(houses[i].mesh(), houses[j].mesh()));
  RecordProperty("most_overlap_of_different_houses", std::to_string(most));
  EXPECT_LT(most, 0.5 * kNearDuplicate);
  TriangleMesh moved = houses[0].mesh();
  std::uint32_t draw = 0;
  const RandomStream random(1, Purpose::test);
  for (glm::vec3& vertex : moved.vertices) {
    vertex += glm::vec3(3, 0, -2);
    for (int axis = 0; axis < 3; ++axis) vertex[axis] += 0.002f * (random.uniform(draw++) - 0.5f);
  }
  EXPECT_GT(geometry_overlap(houses[0].mesh(), moved), kNearDuplicate);
  EXPECT_EQ(geometry_overlap(houses[0].mesh(), houses[0].mesh()), 1);
}

TEST(SplitOverlap, FindsSoundsByNameAndBySamples) {
  const auto find = [](const Names& trained, const Names& tested) { return find_sound_overlap(trained, tested, ""); };
  EXPECT_FALSE(find({"synth:bird:0", "synth:telephone:1"}, {"synth:bird:1", "synth:telephone:0"}));
  const auto named = find({"synth:bird"}, {"synth:bird:0"});
  ASSERT_TRUE(named);
  EXPECT_EQ(named->trained, "synth:bird");
  // A recording of a clip at half its level.
  const TestFolder folder("split_sounds");
  std::vector<float> samples = open_sound("synth:bird:3", 16000).samples;
  for (float& sample : samples) sample *= 0.5f;
  const std::string copy = (folder.path() / "other.wav").string();
  write_wav(copy, samples, 1, 16000);
  const auto recorded = find({"synth:bird:2", "synth:bird:3"}, {"synth:bird:4", copy});
  ASSERT_TRUE(recorded);
  EXPECT_EQ(recorded->trained, "synth:bird:3");
  EXPECT_EQ(recorded->why, "another copy of");
}

}  // namespace
}  // namespace earshot
