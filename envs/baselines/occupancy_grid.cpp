// SPDX-License-Identifier: Apache-2.0
#include "envs/baselines/occupancy_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kStartDisc_m = 0.3;
/// Hits in neighbouring columns that are nearer to each other are one surface.
constexpr double kSameSurface_m = 0.25;
/// Lines of free space between two columns: cells as far as 10 m are crossed by one.
constexpr int kLines = 4;

}  // namespace

int OccupancyGrid::cell_of(double metres) { return static_cast<int>(std::floor(std::clamp(metres, -1e6, 1e6) / kCell_m)) + kSize / 2; }
double OccupancyGrid::centre_of(int cell) { return (cell - kSize / 2 + 0.5) * kCell_m; }

OccupancyGrid::OccupancyGrid(const CameraConfig& camera, const NavmeshConfig& body)
    : camera_(camera),
      climb_m_(body.max_climb_m),
      height_m_(body.agent_height_m),
      focal_px_(0.5f * static_cast<float>(camera.width_px) /
                std::tan(0.5f * camera.horizontal_fov_deg * std::numbers::pi_v<float> / 180.f)) {
  clear();
}

void OccupancyGrid::clear() {
  cells_.assign(static_cast<std::size_t>(kSize) * kSize, Cell::unknown);
  near_.assign(cells_.size(), kReach);
  const int reach = static_cast<int>(kStartDisc_m / kCell_m);
  for (int z = -reach; z <= reach; ++z)
    for (int x = -reach; x <= reach; ++x)
      if (x * x + z * z <= reach * reach) mark_free(kSize / 2 + x, kSize / 2 + z);
}

void OccupancyGrid::mark_free(int x, int z) {
  if (inside(x, z) && cells_[index(x, z)] == Cell::unknown) cells_[index(x, z)] = Cell::free;
}

void OccupancyGrid::occupy(int x, int z) {
  if (!inside(x, z) || cells_[index(x, z)] == Cell::occupied) return;
  cells_[index(x, z)] = Cell::occupied;
  for (int dz = -kReach; dz <= kReach; ++dz)
    for (int dx = -kReach; dx <= kReach; ++dx) {
      if (!inside(x + dx, z + dz)) continue;
      const int distance = static_cast<int>(std::sqrt(static_cast<double>(dx * dx + dz * dz)));
      std::uint8_t& near = near_[index(x + dx, z + dz)];
      near = static_cast<std::uint8_t>(std::min<int>(near, distance));
    }
}

void OccupancyGrid::mark_occupied(double x_m, double z_m) { occupy(cell_of(x_m), cell_of(z_m)); }

void OccupancyGrid::find_obstacles(std::span<const float> depth, std::vector<float>& along_m) const {
  const auto width = static_cast<std::size_t>(camera_.width_px), height = static_cast<std::size_t>(camera_.height_px);
  along_m.assign(width, 0.f);
  for (std::size_t y = 0; y < height; ++y) {
    const float down = (static_cast<float>(y) + 0.5f - 0.5f * static_cast<float>(height)) / focal_px_;
    for (std::size_t x = 0; x < width; ++x) {
      if (!(depth[y * width + x] < 1.f)) continue;
      const float d = depth[y * width + x] * camera_.max_depth_m, up_m = camera_.height_m - d * down;
      if (up_m > climb_m_ && up_m < height_m_ && (along_m[x] == 0.f || d < along_m[x])) along_m[x] = d;
    }
  }
}

/// Marks cells free from the agent towards a point, for `length_m` of the way.
void OccupancyGrid::carve(double x_m, double z_m, double to_x_m, double to_z_m, double length_m) {
  const double whole_m = std::hypot(to_x_m - x_m, to_z_m - z_m);
  if (!(whole_m > 0)) return;
  for (double s = 0; s < length_m; s += 0.5 * kCell_m) {
    const int x = cell_of(x_m + s / whole_m * (to_x_m - x_m)), z = cell_of(z_m + s / whole_m * (to_z_m - z_m));
    if (!inside(x, z) || (s > kStartDisc_m && cells_[index(x, z)] == Cell::occupied)) return;
    mark_free(x, z);
  }
}

void OccupancyGrid::add(const PlanarPose& pose, std::span<const float> depth) {
  const auto width = static_cast<std::size_t>(camera_.width_px), height = static_cast<std::size_t>(camera_.height_px);
  EARSHOT_EXPECT(depth.size() == width * height);
  find_obstacles(depth, along_m_);
  const double sine = std::sin(pose.heading_rad), cosine = std::cos(pose.heading_rad);
  // Ahead is (-sine, -cosine), to the right is (cosine, -sine).
  const auto point_x = [&](double ahead_m, double right_m) { return pose.x_m - ahead_m * sine + right_m * cosine; };
  const auto point_z = [&](double ahead_m, double right_m) { return pose.z_m - ahead_m * cosine - right_m * sine; };
  const auto slope = [&](double column) { return (column + 0.5 - 0.5 * static_cast<double>(width)) / static_cast<double>(focal_px_); };

  for (std::size_t x = 0; x < width; ++x) {
    const double d = static_cast<double>(along_m_[x]), slope_at = slope(static_cast<double>(x));
    if (d > 0) occupy(cell_of(point_x(d, d * slope_at)), cell_of(point_z(d, d * slope_at)));
    if (x + 1 == width) continue;
    const double next = static_cast<double>(along_m_[x + 1]), next_slope = slope(static_cast<double>(x + 1));
    const double apart_m = std::hypot(next - d, next * next_slope - d * slope_at);
    if (d > 0 && next > 0 && apart_m < kSameSurface_m)
      for (double t = 0; t < 1; t += 0.5 * kCell_m / std::max(apart_m, 0.5 * kCell_m)) {
        const double ahead = d + t * (next - d), right = d * slope_at + t * (next * next_slope - d * slope_at);
        occupy(cell_of(point_x(ahead, right)), cell_of(point_z(ahead, right)));
      }
  }
  for (std::size_t x = 0; x + 1 < width; ++x) {
    const double reach = static_cast<double>(camera_.max_depth_m);
    const double a = along_m_[x] > 0 ? static_cast<double>(along_m_[x]) : reach,
                 b = along_m_[x + 1] > 0 ? static_cast<double>(along_m_[x + 1]) : reach;
    for (int line = 0; line < kLines; ++line) {
      const double right = slope(static_cast<double>(x) + static_cast<double>(line) / kLines), ahead = std::min(a, b);
      carve(pose.x_m, pose.z_m, point_x(ahead, ahead * right), point_z(ahead, ahead * right),
            ahead * std::hypot(1.0, right) - 0.5 * kCell_m);
    }
  }
}

double OccupancyGrid::misfit(const PlanarPose& pose, std::span<const float> depth) const {
  std::vector<float> along_m;
  find_obstacles(depth, along_m);
  const double sine = std::sin(pose.heading_rad), cosine = std::cos(pose.heading_rad);
  double sum = 0;
  for (std::size_t x = 0; x < along_m.size(); ++x) {
    const double d = static_cast<double>(along_m[x]);
    if (!(d > 0)) continue;
    const double right = d * (static_cast<double>(x) + 0.5 - 0.5 * static_cast<double>(along_m.size())) / static_cast<double>(focal_px_);
    const int cx = cell_of(pose.x_m - d * sine + right * cosine), cz = cell_of(pose.z_m - d * cosine - right * sine);
    sum += inside(cx, cz) ? near_[index(cx, cz)] : kReach;
  }
  return sum;
}

}  // namespace earshot
