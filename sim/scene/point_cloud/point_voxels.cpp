// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/point_voxels.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <utility>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kNoiseFraction = 0.2;    // of the points of a neighbour
constexpr std::size_t kStrayVoxels = 10;  // groups of fewer are stray

using KeyedPoints = std::vector<std::pair<std::uint64_t, std::uint32_t>>;  // voxel, index of the point

struct PointBounds {
  glm::dvec3 lower{std::numeric_limits<double>::infinity()}, upper{-std::numeric_limits<double>::infinity()};
};

PointBounds bounds_of_points(std::span<const glm::dvec3> positions) {
  PointBounds bounds;
  for (const glm::dvec3& p : positions) {
    bounds.lower = glm::min(bounds.lower, p);
    bounds.upper = glm::max(bounds.upper, p);
  }
  return bounds;
}

KeyedPoints key_points(std::span<const glm::dvec3> positions, glm::dvec3 lower, double cell_m) {
  KeyedPoints keyed(positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i)
    keyed[i] = {voxel_key(glm::ivec3((positions[i] - lower) / cell_m)), static_cast<std::uint32_t>(i)};
  std::sort(keyed.begin(), keyed.end());
  return keyed;
}

glm::ivec3 cell_of_key(std::uint64_t key) {
  constexpr std::uint64_t mask = kMaxCells - 1;
  return {static_cast<int>(key & mask), static_cast<int>(key >> 21 & mask), static_cast<int>(key >> 42)};
}

void add_points(VoxelPoints& to, const VoxelPoints& from) {
  to.count += from.count;
  to.sum += from.sum;
  for (std::size_t i = 0; i < to.products.size(); ++i) to.products[i] += from.products[i];
}

std::vector<VoxelPoints> count_points(std::span<const glm::dvec3> positions, glm::dvec3 lower, double cell_m) {
  std::vector<VoxelPoints> voxels;
  std::uint64_t last = 0;
  for (const auto& [key, index] : key_points(positions, lower, cell_m)) {
    if (voxels.empty() || key != last) voxels.push_back({.cell = cell_of_key(key)});
    last = key;
    const glm::dvec3 p = positions[index] - lower;
    add_points(voxels.back(),
               {.cell = {}, .count = 1, .sum = p, .products = {p.x * p.x, p.x * p.y, p.x * p.z, p.y * p.y, p.y * p.z, p.z * p.z}});
  }
  return voxels;
}

using VoxelIndex = std::unordered_map<std::uint64_t, std::uint32_t>;

/// Hands the points of noise to the neighbour with most points, and on where that one is noise itself.
void merge_noise(std::vector<VoxelPoints>& voxels) {
  VoxelIndex index;
  index.reserve(voxels.size());
  for (std::uint32_t i = 0; i < voxels.size(); ++i) index.emplace(voxel_key(voxels[i].cell), i);
  std::vector<std::uint32_t> target(voxels.size());
  for (std::uint32_t i = 0; i < voxels.size(); ++i) {
    std::uint32_t best = i;
    for (int axis = 0; axis < 3; ++axis) {
      for (const int step : {-1, 1}) {
        glm::ivec3 cell = voxels[i].cell;
        cell[axis] += step;
        if (cell[axis] < 0 || cell[axis] >= kMaxCells) continue;
        const auto found = index.find(voxel_key(cell));
        if (found != index.end() && voxels[found->second].count > voxels[best].count) best = found->second;
      }
    }
    target[i] = double{1} * voxels[i].count < kNoiseFraction * voxels[best].count ? best : i;
  }
  for (std::uint32_t i = 0; i < voxels.size(); ++i) {
    std::uint32_t kept_in = i;
    while (target[kept_in] != kept_in) kept_in = target[kept_in];  // counts grow: it ends
    if (kept_in != i) add_points(voxels[kept_in], voxels[i]);
  }
  std::size_t kept = 0;
  for (std::uint32_t i = 0; i < voxels.size(); ++i)
    if (target[i] == i) voxels[kept++] = voxels[i];
  voxels.resize(kept);
}

/// Groups of voxels: those in neighbouring cubes of two voxels belong together.  Returns the points of groups that were left out.
std::uint64_t remove_stray(std::vector<VoxelPoints>& voxels) {
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cubes;
  for (std::uint32_t i = 0; i < voxels.size(); ++i) cubes[voxel_key(voxels[i].cell / 2)].push_back(i);
  std::vector<bool> is_seen(voxels.size()), is_stray(voxels.size());
  std::vector<std::uint32_t> group;
  for (std::uint32_t first = 0; first < voxels.size(); ++first) {
    if (is_seen[first]) continue;
    group.clear();
    const auto take_cube = [&](glm::ivec3 cube) {
      if (std::min({cube.x, cube.y, cube.z}) < 0 || std::max({cube.x, cube.y, cube.z}) >= kMaxCells) return;
      const auto found = cubes.find(voxel_key(cube));
      if (found == cubes.end() || is_seen[found->second.front()]) return;
      for (const std::uint32_t member : found->second) is_seen[member] = true, group.push_back(member);
    };
    take_cube(voxels[first].cell / 2);
    for (std::size_t at = 0; at < group.size(); ++at) {
      const glm::ivec3 cube = voxels[group[at]].cell / 2;
      for (int z = -1; z <= 1; ++z)
        for (int y = -1; y <= 1; ++y)
          for (int x = -1; x <= 1; ++x) take_cube(cube + glm::ivec3(x, y, z));
    }
    if (group.size() < kStrayVoxels)
      for (const std::uint32_t member : group) is_stray[member] = true;
  }
  std::uint64_t points = 0;
  std::size_t kept = 0;
  for (std::uint32_t i = 0; i < voxels.size(); ++i) {
    if (is_stray[i])
      points += voxels[i].count;
    else
      voxels[kept++] = voxels[i];
  }
  voxels.resize(kept);
  return points;
}

/// Moves the first voxel so that `margin` empty ones lie around all.
void move_to_margin(PointVoxels& sorted, int margin) {
  glm::ivec3 lower(kMaxCells), upper(0);
  for (const VoxelPoints& voxel : sorted.voxels) {
    lower = glm::min(lower, voxel.cell);
    upper = glm::max(upper, voxel.cell);
  }
  const glm::ivec3 shift = lower - margin;
  const glm::dvec3 shift_m = glm::dvec3(shift) * sorted.cell_m;
  for (VoxelPoints& voxel : sorted.voxels) {
    voxel.cell -= shift;
    const double n = voxel.count;
    const glm::dvec3 s = voxel.sum, d = shift_m;
    std::size_t i = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b) voxel.products[i++] += n * d[a] * d[b] - d[a] * s[b] - d[b] * s[a];
    voxel.sum -= n * d;
  }
  sorted.origin_m += shift_m;
  sorted.size = upper - lower + 1 + 2 * margin;
}

/// Distance to the nearest point at another place within the 27 cells around; infinite if there is none.
double nearest_m(std::span<const glm::dvec3> positions, const KeyedPoints& keyed, glm::dvec3 lower, double cell_m, std::size_t point) {
  const glm::dvec3 place = positions[point];
  const glm::ivec3 centre((place - lower) / cell_m);
  double nearest = std::numeric_limits<double>::infinity();
  for (int z = -1; z <= 1; ++z) {
    for (int y = -1; y <= 1; ++y) {
      for (int x = -1; x <= 1; ++x) {
        const glm::ivec3 cell = centre + glm::ivec3(x, y, z);
        if (std::min({cell.x, cell.y, cell.z}) < 0) continue;
        const std::uint64_t key = voxel_key(cell);
        for (auto at = std::lower_bound(keyed.begin(), keyed.end(), std::pair(key, std::uint32_t{0}));
             at != keyed.end() && at->first == key; ++at) {
          const double distance = glm::distance(positions[at->second], place);
          if (distance > 0) nearest = std::min(nearest, distance);
        }
      }
    }
  }
  return nearest;
}

}  // namespace

PointVoxels sort_into_voxels(std::span<const glm::dvec3> positions, double cell_m, int margin, const std::string& where) {
  const PointBounds bounds = bounds_of_points(positions);
  const glm::dvec3 cells = (bounds.upper - bounds.lower) / cell_m;
  if (std::max({cells.x, cells.y, cells.z}) > kMaxCells - 1000)
    throw InputError(where,
                     fmt::format("extends over {:.0f} cells of {:g} m, and at most {} are held", std::max({cells.x, cells.y, cells.z}),
                                 cell_m, kMaxCells - 1000),
                     "give a larger cell, or remove points that lie far off");
  PointVoxels sorted{
      .cell_m = cell_m, .origin_m = bounds.lower, .size = {}, .voxels = count_points(positions, bounds.lower, cell_m), .stray_points = 0};
  merge_noise(sorted.voxels);
  sorted.stray_points = remove_stray(sorted.voxels);
  if (sorted.voxels.empty())
    throw InputError(where, fmt::format("its points are too sparse for a cell of {:g} m: no surface holds ten voxels", cell_m),
                     "give a larger cell (--cell, or FILE,cell=METRES)");
  move_to_margin(sorted, margin);
  return sorted;
}

double median_spacing_m(std::span<const glm::dvec3> positions) {
  constexpr std::size_t kSamples = 2048, kFewest = 8;
  const PointBounds bounds = bounds_of_points(positions);
  const double extent_m = glm::length(bounds.upper - bounds.lower);
  if (!(extent_m > 0)) return 0;
  // Cells that the median point shares with some others: from fine to coarse.
  double cell_m = extent_m / 4096;
  KeyedPoints keyed;
  for (;; cell_m *= 2) {
    keyed = key_points(positions, bounds.lower, cell_m);
    std::size_t num_shared = 0;  // points in cells of at least kFewest
    for (std::size_t begin = 0, end = 0; begin < keyed.size(); begin = end) {
      while (end < keyed.size() && keyed[end].first == keyed[begin].first) ++end;
      if (end - begin >= kFewest) num_shared += end - begin;
    }
    if (2 * num_shared >= keyed.size() || cell_m > extent_m) break;
  }
  std::vector<double> distances;
  const std::size_t step = std::max<std::size_t>(1, positions.size() / kSamples);
  for (std::size_t i = 0; i < positions.size(); i += step) {
    const double distance = nearest_m(positions, keyed, bounds.lower, cell_m, i);
    distances.push_back(std::isfinite(distance) ? distance : cell_m);
  }
  std::nth_element(distances.begin(), distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2), distances.end());
  return distances[distances.size() / 2];
}

}  // namespace earshot
