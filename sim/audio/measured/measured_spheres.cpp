// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/measured_spheres.h"

#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <numbers>
#include <numeric>
#include <unordered_map>

namespace earshot {
namespace {

constexpr double kSameDistance = 1.04, kCoverage = 0.8;
constexpr double kSameDirection = 0.1 * std::numbers::pi / 180.0;
constexpr int kCellsPerSide = 3;
using Cells = std::bitset<6 * kCellsPerSide * kCellsPerSide>;
using Measurements = std::vector<std::size_t>;

/// Cell of a cube around the head in which a direction lies.
std::size_t cell_of(glm::dvec3 direction) {
  const std::array<double, 3> axis = {direction.x, direction.y, direction.z};
  std::size_t face = 0;
  for (std::size_t i = 1; i < 3; ++i)
    if (std::abs(axis[i]) > std::abs(axis[face])) face = i;
  const auto along = [&](std::size_t other) {
    const double position = 0.5 + std::atan(axis[other] / std::abs(axis[face])) * 2.0 / std::numbers::pi;
    return static_cast<std::size_t>(std::clamp(static_cast<int>(position * kCellsPerSide), 0, kCellsPerSide - 1));
  };
  return ((2 * face + (axis[face] < 0 ? 1 : 0)) * kCellsPerSide + along((face + 1) % 3)) * kCellsPerSide + along((face + 2) % 3);
}

Cells cells_of(std::span<const glm::vec3> direction, const Measurements& measurements) {
  Cells cells;
  for (const std::size_t m : measurements) cells.set(cell_of(glm::dvec3(direction[m])));
  return cells;
}

/// Directions that were measured, found by place.
class DirectionTable {
 public:
  /// The number of the direction that lies within kSameDirection of this one; a new one if there is none.
  std::size_t number_of(glm::dvec3 direction) {
    const std::array<std::int64_t, 3> home = place(direction);
    for (std::int64_t x = -1; x <= 1; ++x)
      for (std::int64_t y = -1; y <= 1; ++y)
        for (std::int64_t z = -1; z <= 1; ++z) {
          const auto found = at_place_.equal_range(key({home[0] + x, home[1] + y, home[2] + z}));
          for (auto entry = found.first; entry != found.second; ++entry)
            if (glm::length(directions_[entry->second] - direction) < kSameDirection) return entry->second;
        }
    at_place_.emplace(key(home), directions_.size());
    directions_.push_back(direction);
    return directions_.size() - 1;
  }

 private:
  static std::array<std::int64_t, 3> place(glm::dvec3 direction) {
    const auto along = [](double value) { return static_cast<std::int64_t>(std::floor(value / kSameDirection)); };
    return {along(direction.x), along(direction.y), along(direction.z)};
  }
  static std::int64_t key(std::array<std::int64_t, 3> place) {
    constexpr std::int64_t span = 4096;  // 2 / kSameDirection and some more
    return (place[0] * span + place[1]) * span + place[2];
  }
  std::unordered_multimap<std::int64_t, std::size_t> at_place_;
  std::vector<glm::dvec3> directions_;
};

MeasuredSphere make_sphere(std::span<const glm::vec3> direction, std::span<const float> distance_m, const Measurements& measurements) {
  MeasuredSphere sphere;
  DirectionTable table;
  for (const std::size_t m : measurements) {  // the farthest first
    const std::size_t number = table.number_of(glm::dvec3(direction[m]));
    if (number == sphere.directions.size()) sphere.directions.push_back({direction[m], {}});
    Measurements& copies = sphere.directions[number].copies;
    if (copies.empty() || distance_m[m] * kSameDistance >= distance_m[copies.front()]) copies.push_back(m);
  }
  // In the order of the file, whatever the distances.
  for (MeasuredDirection& measured : sphere.directions) std::ranges::sort(measured.copies);
  std::ranges::sort(sphere.directions, {}, [](const MeasuredDirection& measured) { return measured.copies.front(); });
  for (const MeasuredDirection& measured : sphere.directions)
    sphere.distance_m += static_cast<double>(distance_m[measured.copies.front()]) / static_cast<double>(sphere.directions.size());
  return sphere;
}

}  // namespace

std::vector<MeasuredSphere> sort_into_spheres(std::span<const glm::vec3> direction, std::span<const float> distance_m) {
  Measurements order(direction.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::greater<>(), [&](std::size_t m) { return distance_m[m]; });
  const std::size_t wanted = cells_of(direction, order).count();
  std::vector<Measurements> groups;  // the farthest first
  double before = 0;
  for (const std::size_t m : order) {
    const auto distance = static_cast<double>(distance_m[m]);
    if (groups.empty() || distance * kSameDistance < before) groups.emplace_back();
    groups.back().push_back(m);
    before = distance;
  }
  const auto covers = [&](const Measurements& group) {
    return static_cast<double>(cells_of(direction, group).count()) >= kCoverage * static_cast<double>(wanted);
  };
  std::vector<Measurements> whole;
  for (const Measurements& group : groups) {
    if (whole.empty() || (covers(group) && covers(whole.back())))
      whole.push_back(group);
    else
      whole.back().insert(whole.back().end(), group.begin(), group.end());
  }
  std::vector<MeasuredSphere> spheres;
  for (auto group = whole.rbegin(); group != whole.rend(); ++group) spheres.push_back(make_sphere(direction, distance_m, *group));
  return spheres;
}

}  // namespace earshot
