// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "envs/task/av_nav_task.h"
#include "sim/nav/navmesh.h"
#include "sim/vision/camera.h"

namespace earshot {

/// Where an agent thinks it is: metres from its start, as it faced then (x to its right, z behind it), heading counter-clockwise.
struct PlanarPose {
  double x_m = 0, z_m = 0, heading_rad = 0;
};

/// A map of what an agent has seen: square cells that are unknown, free or occupied, from depth pictures of a level pinhole camera and
/// poses in the map's own frame.  A cell is occupied if a surface stands between max_climb_m and agent_height_m above the floor, and free
/// if it lies before one or its floor is visible.  Occupied cells stay occupied.
class OccupancyGrid {
 public:
  static constexpr double kCell_m = 0.05;
  static constexpr int kSize = 640;  ///< cells along a side: 32 m, the start in the middle; the area outside is not mapped
  enum class Cell : std::uint8_t { unknown, free, occupied };

  OccupancyGrid(const CameraConfig& camera, const NavmeshConfig& body);
  /// All unknown, but for a disc of 0.3 m around the start, which is free.
  void clear();
  /// depth [height, width] of the camera, in [0, 1].  About 0.1 ms for 64 x 64.
  void add(const PlanarPose& pose, std::span<const float> depth);
  /// Marks the cell at these coordinates, which an agent bumped into.
  void mark_occupied(double x_m, double z_m);
  /// Sum over what `depth` shows of the distance to the nearest mapped obstacle, in cells, at most kReach each: the pose for which it is
  /// least fits the map best.
  [[nodiscard]] double misfit(const PlanarPose& pose, std::span<const float> depth) const;

  [[nodiscard]] Cell at(int x, int z) const { return cells_[index(x, z)]; }
  /// Cells to the nearest obstacle, kReach if it is farther.
  [[nodiscard]] int clearance(int x, int z) const { return near_[index(x, z)]; }
  static constexpr int kReach = 6;
  [[nodiscard]] static int cell_of(double metres);  ///< may lie outside
  [[nodiscard]] static double centre_of(int cell);  ///< in metres
  [[nodiscard]] static bool inside(int x, int z) { return x >= 0 && z >= 0 && x < kSize && z < kSize; }
  [[nodiscard]] static std::size_t index(int x, int z) { return static_cast<std::size_t>(z) * kSize + static_cast<std::size_t>(x); }

 private:
  /// Nearest obstacle in each column of the picture: metres along the view axis; 0: none within reach.
  void find_obstacles(std::span<const float> depth, std::vector<float>& along_m) const;
  void carve(double x_m, double z_m, double to_x_m, double to_z_m, double length_m);
  void mark_free(int x, int z);
  void occupy(int x, int z);

  CameraConfig camera_;
  float climb_m_, height_m_, focal_px_;
  std::vector<Cell> cells_;
  std::vector<std::uint8_t> near_;
  std::vector<float> along_m_;
};

}  // namespace earshot
