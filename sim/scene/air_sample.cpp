// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/air_sample.h"

#include <algorithm>
#include <numeric>
#include <span>

#include "sim/scene/probe_rays.h"

namespace earshot {
namespace {

using probe::Use;

constexpr std::uint32_t kCellsPerAxis = 16, kCells = kCellsPerAxis * kCellsPerAxis * kCellsPerAxis, kPasses = 4;

/// Union-find: points in line of sight of each other, directly or through others.
class Regions {
 public:
  explicit Regions(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Stratified points of the bounds that have a floor below them.
std::vector<glm::vec3> points_over_floor(const Scene& scene, std::uint64_t seed) {
  const Bounds& bounds = scene.bounds();
  glm::vec3 size = bounds.upper - bounds.lower;
  size.y = std::max(size.y, 0.01f * std::max(size.x, size.z));  // a flat scene has its air above it
  std::vector<glm::vec3> points;
  for (std::uint32_t i = 0; i < kPasses * kCells; ++i) {
    const std::uint32_t cell = i % kCells;
    const std::array<float, 4> u = probe::stream(seed, Use::place, i).uniform4(0);
    const glm::vec3 fraction((static_cast<float>(cell % kCellsPerAxis) + u[0]) / kCellsPerAxis,
                             (static_cast<float>(cell / kCellsPerAxis % kCellsPerAxis) + u[1]) / kCellsPerAxis,
                             (static_cast<float>(cell / kCellsPerAxis / kCellsPerAxis) + u[2]) / kCellsPerAxis);
    const glm::vec3 point = bounds.lower + fraction * size;
    if (scene.rays().intersect(point, {0, -1, 0}).valid()) points.push_back(point);
  }
  return points;
}

/// Points of the largest region of air.  Walks from each point test, at every bounce, the line of sight to another point.
std::vector<std::uint32_t> largest_region(const Scene& scene, std::span<const glm::vec3> points, std::uint64_t seed) {
  if (points.empty()) return {};
  const auto count = static_cast<std::uint32_t>(points.size());
  Regions regions(count);
  constexpr std::uint32_t region_bounces = 6;
  for (std::uint32_t i = 0; i < count; ++i) {
    const RandomStream random = probe::stream(seed, Use::partner, i);
    glm::vec3 from = points[i], direction = probe::uniform_direction(random.uniform2(0));
    for (std::uint32_t bounce = 1; bounce <= region_bounces; ++bounce) {
      const std::uint32_t other = random.below(count, 2 * bounce);
      if (regions.find(i) != regions.find(other) && !scene.rays().occluded(from, points[other])) regions.join(i, other);
      const Hit hit = scene.rays().intersect(from, direction);
      if (!hit.valid()) break;
      from = offset_from_surface(hit.position, hit.normal);
      direction = probe::cosine_direction(hit.normal, random.uniform2(2 * bounce + 1));
    }
  }
  std::vector<std::uint32_t> size(count, 0);
  for (std::uint32_t i = 0; i < count; ++i) ++size[regions.find(i)];
  const auto largest = static_cast<std::uint32_t>(std::max_element(size.begin(), size.end()) - size.begin());
  std::vector<std::uint32_t> members;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (regions.find(i) == largest) members.push_back(i);
  }
  return members;
}

}  // namespace

AirSample sample_air(const Scene& scene, std::uint64_t seed) {
  AirSample sample;
  if (scene.mesh().triangles.empty()) return sample;
  const std::vector<glm::vec3> points = points_over_floor(scene, seed);
  for (const std::uint32_t member : largest_region(scene, points, seed)) sample.points.push_back(points[member]);
  sample.fraction_of_bounds = static_cast<double>(sample.points.size()) / (kPasses * kCells);
  return sample;
}

}  // namespace earshot
