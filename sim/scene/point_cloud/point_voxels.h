// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

namespace earshot {

/// The points of one voxel: their number, sum and products, relative to the corner of the first voxel, in metres.
struct VoxelPoints {
  glm::ivec3 cell;
  std::uint32_t count = 0;
  glm::dvec3 sum{0};
  std::array<double, 6> products{};  ///< sums of xx, xy, xz, yy, yz, zz
};

/// Points sorted into voxels that hold a surface.
struct PointVoxels {
  double cell_m = 0;
  glm::dvec3 origin_m{0};           ///< corner of the voxel (0, 0, 0)
  glm::ivec3 size{0};               ///< voxels along each axis
  std::vector<VoxelPoints> voxels;  ///< by z, then y, then x
  std::uint64_t stray_points = 0;   ///< left out
};

/// One word of 64 bits for a voxel with coordinates in [0, kMaxCells).
inline constexpr int kMaxCells = 1 << 21;
inline std::uint64_t voxel_key(glm::ivec3 cell) {
  return static_cast<std::uint64_t>(cell.z) << 42 | static_cast<std::uint64_t>(cell.y) << 21 | static_cast<std::uint64_t>(cell.x);
}

/// Sorts points into voxels of the edge `cell_m`.  A voxel with less than a fifth of the points of a neighbour is noise of that one's
/// surface: its points are counted there, or in the one that that one's are counted in.  Groups of fewer than ten voxels with nothing
/// within two voxels of them are stray points: left out and counted.  margin: empty voxels around all.  Throws InputError for points over
/// more than kMaxCells voxels and where all points are stray. O(n log n), 16 bytes a point; the same for any order of equal points.
PointVoxels sort_into_voxels(std::span<const glm::dvec3> positions, double cell_m, int margin, const std::string& where);

/// Median distance of a point from its nearest neighbour at another place, over up to 2,048 points of the cloud; 0 if all are at one place.
double median_spacing_m(std::span<const glm::dvec3> positions);

}  // namespace earshot
