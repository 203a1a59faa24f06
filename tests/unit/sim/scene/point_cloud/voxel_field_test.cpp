// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/voxel_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <set>
#include <tuple>

#include "sim/base/random.h"

namespace earshot {
namespace {

using Voxel = std::tuple<int, int, int>;

/// Free voxels that faces join to `seed`, one voxel at a time.
std::set<Voxel> joined_to(const VoxelField& field, glm::ivec3 seed, int edge) {
  std::set<Voxel> joined{{seed.x, seed.y, seed.z}};
  std::deque<glm::ivec3> queue{seed};
  for (; !queue.empty(); queue.pop_front()) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const int step : {-1, 1}) {
        glm::ivec3 near = queue.front();
        near[axis] += step;
        if (near[axis] < 0 || near[axis] >= edge || field.label(near) != VoxelLabel::free) continue;
        if (joined.emplace(near.x, near.y, near.z).second) queue.push_back(near);
      }
    }
  }
  return joined;
}

// Walls with doors and clutter, drawn, over blocks near a surface and blocks of one label.
TEST(VoxelField, AFloodTakesWhatFacesJoin) {
  constexpr int edge = 40;
  int num_flooded = 0;
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RandomStream random(47, Purpose::test, number);
    std::uint32_t draw = 0;
    const auto below = [&](int limit) { return static_cast<int>(random.below(static_cast<std::uint32_t>(limit), draw++)); };
    VoxelField field(glm::ivec3(edge), 0.1, "field");
    for (int wall = 0; wall < 3; ++wall) {
      const int axis = below(3), at = 1 + below(edge - 2), u = (axis + 1) % 3, v = (axis + 2) % 3, door = below(2 * edge);
      for (int i = 0; i < edge; ++i) {
        for (int j = 0; j < edge; ++j) {
          glm::ivec3 voxel(at);
          voxel[u] = i;
          voxel[v] = j;
          if (i != door || j != door) field.set_distance(voxel, 0);
        }
      }
    }
    for (int i = 0; i < 200; ++i) field.set_distance({below(edge), below(edge), below(12)}, static_cast<std::uint8_t>(below(4)));
    field.reset_labels(1);
    const glm::ivec3 seed(below(edge), below(edge), below(edge));
    if (field.label(seed) != VoxelLabel::free) continue;
    ++num_flooded;
    const std::set<Voxel> expected = joined_to(field, seed, edge);
    std::uint8_t farthest = 0;
    for (const auto& [x, y, z] : expected) farthest = std::max(farthest, field.distance({x, y, z}));
    const VoxelField::Flooded flooded = field.flood(seed, VoxelLabel::air);
    EXPECT_EQ(flooded.count, expected.size());
    EXPECT_EQ(flooded.farthest, farthest);
    for (int x = 0; x < edge; ++x)
      for (int y = 0; y < edge; ++y)
        for (int z = 0; z < edge; ++z)
          ASSERT_EQ(field.label({x, y, z}) == VoxelLabel::air, expected.contains({x, y, z})) << x << ' ' << y << ' ' << z;
  }
  EXPECT_GE(num_flooded, 8);
}

}  // namespace
}  // namespace earshot
