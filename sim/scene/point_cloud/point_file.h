// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace earshot {

/// Points of a file, in its axes and units, in its order.
struct PointCloud {
  std::vector<glm::dvec3> positions;  ///< finite ones
  std::uint64_t num_invalid = 0;      ///< left out: a coordinate that is not finite, or withheld (LAS)
  std::vector<std::string> warnings;  ///< one line each
};

/// Limit on the points of one file: 1.6 GB of positions.
inline constexpr std::uint64_t kMaxPoints = std::uint64_t{1} << 26;

/// Throws InputError if a file declares or holds more points than kMaxPoints.
void require_point_count(std::uint64_t count, const std::string& where);

/// Whether the file holds points and no faces: by its extension (pcd, xyz, pts, asc, las, laz), or a PLY whose header declares vertices and
/// no element with faces.  False for a file that cannot be read.
bool is_point_cloud(const std::filesystem::path& path);

/// Whether the extension is las or laz: their z is the height.
bool is_las_file(const std::filesystem::path& path);

/// Reads a point cloud with the reader of its format.  Throws InputError naming the file: missing, damaged, a format that is not read
/// (LAZ), no points, too many points.  About 0.1 s per million points in binary, 0.5 s in text.
PointCloud read_point_file(const std::filesystem::path& path);

}  // namespace earshot
