// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/generators/floor_plan.h"

#include <gtest/gtest.h>

#include <map>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/scene.h"

namespace earshot {
namespace {

TEST(FloorPlan, EveryRoomIsReachedThroughDoors) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const HousePlan plan = make_floor_plan({.seed = seed});
    std::vector<bool> reached(plan.rooms.size(), false);
    reached[0] = true;
    for (std::size_t round = 0; round < plan.rooms.size(); ++round)
      for (const PlanDoor& door : plan.doors) {
        const bool either = reached[static_cast<std::size_t>(door.room_a)] || reached[static_cast<std::size_t>(door.room_b)];
        reached[static_cast<std::size_t>(door.room_a)] = reached[static_cast<std::size_t>(door.room_b)] = either;
      }
    for (std::size_t room = 0; room < reached.size(); ++room) EXPECT_TRUE(reached[room]) << "seed " << seed << ", room " << room;
    for (std::size_t a = 0; a < plan.rooms.size(); ++a)
      for (std::size_t b = a + 1; b < plan.rooms.size(); ++b)
        EXPECT_FALSE(plan.rooms[a].floor.overlaps(plan.rooms[b].floor)) << a << " " << b;
  }
}

TEST(FloorPlan, HasTheSizeAskedForAndClosedWalls) {
  const TriangleMesh mesh = generate_floor({.seed = 1, .furnished = false});
  const Bounds bounds = bounds_of(mesh);
  EXPECT_NEAR(bounds.upper.x - bounds.lower.x, 25.f, 0.1f);
  EXPECT_NEAR(bounds.upper.z - bounds.lower.z, 57.f, 0.1f);
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;  // +1 one way, -1 the other
  for (const glm::uvec3 t : mesh.triangles)
    for (const auto& [a, b] : {std::pair(t.x, t.y), std::pair(t.y, t.z), std::pair(t.z, t.x)}) edges[std::minmax(a, b)] += a < b ? 1 : -1;
  for (const auto& [edge, sum] : edges) ASSERT_EQ(sum, 0) << edge.first << " " << edge.second;
}

TEST(FloorPlan, SameSeedSameMeshAndASpecToType) {
  EXPECT_EQ(load_scene("floor:3,furnished=false").hash(), load_scene("floor:3,furnished=false").hash());
  EXPECT_NE(load_scene("floor:3,furnished=false").hash(), load_scene("floor:4,furnished=false").hash());
  EXPECT_GT(load_scene("floor:1,width_m=20,length_m=30,detail_m=0.4").mesh().triangles.size(), 30'000u);
  for (const char* wrong : {"floor:", "floor:1,rooms=3", "floor:1,width_m=3", "floor:1,length_m=x"})
    EXPECT_THROW(load_scene(wrong), InputError) << wrong;
}

}  // namespace
}  // namespace earshot
