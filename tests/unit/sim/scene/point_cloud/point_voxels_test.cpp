// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/point_voxels.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "sim/scene/generators/shoebox.h"
#include "tests/support/files/cloud_files.h"

namespace earshot {
namespace {

std::uint64_t points_in(const PointVoxels& sorted) {
  std::uint64_t points = sorted.stray_points;
  for (const VoxelPoints& voxel : sorted.voxels) points += voxel.count;
  return points;
}

// A voxel of one point on one of ten points on one of a hundred: all are counted in the last one.
TEST(PointVoxels, NoiseOnNoiseIsCountedWithItsSurface) {
  for (std::uint32_t number = 0; number < 8; ++number) {
    const RandomStream random(41, Purpose::test, number);
    const glm::ivec3 column(random.below(8, 0), random.below(8, 1), 0);
    Points points;
    const auto fill = [&](glm::ivec3 cell, int count) {
      for (int i = 0; i < count; ++i) points.push_back(glm::dvec3(cell) + (1 + static_cast<double>(i)) / (2 + count));
    };
    points.emplace_back(0, 0, 0);
    for (int x = 0; x < 8; ++x)
      for (int y = 0; y < 8; ++y) fill({x, y, 0}, 100);
    fill(column + glm::ivec3(0, 0, 1), 10);
    fill(column + glm::ivec3(0, 0, 2), 1);
    const PointVoxels sorted = sort_into_voxels(points, 1, 0, "points");
    EXPECT_EQ(sorted.voxels.size(), 64u);
    EXPECT_EQ(sorted.stray_points, 0u);
    EXPECT_EQ(points_in(sorted), points.size());
    const auto found = std::ranges::find_if(sorted.voxels, [&](const VoxelPoints& voxel) { return voxel.cell == column; });
    ASSERT_NE(found, sorted.voxels.end());
    EXPECT_EQ(found->count, column == glm::ivec3(0) ? 112u : 111u);
  }
}

TEST(PointVoxels, NoPointIsLost) {
  for (std::uint32_t number = 0; number < 6; ++number) {
    const double cell_m = 0.03 + 0.02 * number;
    const Points points = sample_surface(make_shoebox({4, 3, 5}), 60'000, 0.03, number);
    EXPECT_EQ(points_in(sort_into_voxels(points, cell_m, 2, "points")), points.size()) << cell_m;
  }
}

}  // namespace
}  // namespace earshot
