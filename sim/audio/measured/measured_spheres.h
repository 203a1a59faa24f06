// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

namespace earshot {

/// A direction of a head, and its measurements by number: copies of it.
struct MeasuredDirection {
  glm::vec3 direction{0};  ///< that of its farthest copy; no two of a sphere within 0.1 degrees
  std::vector<std::size_t> copies;
};

/// Measurements of a head from one distance, each direction once.
struct MeasuredSphere {
  double distance_m = 0;  ///< mean over the directions
  std::vector<MeasuredDirection> directions;
};

/// Sorts the measurements of a head into spheres, the nearest first.
/// Distances within 4 % of each other are one sphere.  Distances of which less than 80 % of the directions of the file (in cells of 30
/// degrees) are covered, as a ring beside a sphere or loudspeakers in the corners of a room, do not form a sphere: they count to the
/// next farther one, the farthest to the next nearer, and of several distances in one direction the farthest counts.
/// Measurements within 0.1 degrees are copies of one direction.  direction: unit; distance_m: positive, or all 0 where they are not known;
/// the same length.  About O(n log n).
std::vector<MeasuredSphere> sort_into_spheres(std::span<const glm::vec3> direction, std::span<const float> distance_m);

}  // namespace earshot
