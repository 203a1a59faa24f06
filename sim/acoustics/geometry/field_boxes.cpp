// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/field_boxes.h"

namespace earshot {
namespace {

constexpr float kMaxBoxes = 16'384.f;

}  // namespace

FieldBoxes::FieldBoxes(const Bounds& bounds, float edge_m) : origin_(bounds.lower) {
  const glm::vec3 size = glm::max(bounds.upper - bounds.lower, glm::vec3(1e-3f));
  for (float edge = edge_m;; edge *= 1.1f) {
    const glm::vec3 boxes = glm::max(glm::round(size / edge), glm::vec3(1.f));
    if (!(boxes.x * boxes.y * boxes.z <= kMaxBoxes)) continue;
    count_ = glm::ivec3(boxes);
    break;
  }
  edge_m_ = size / glm::vec3(count_);
  points_per_m_ = static_cast<float>(kPointsPerEdge) / edge_m_;
}

glm::vec3 FieldBoxes::lattice_point(const glm::ivec3& index, const glm::ivec3& at) const {
  // The sequence of Roberts (2018) in three dimensions, from another start in each box: as even as jitter can be, and quick.
  constexpr glm::dvec3 step(0.8191725133961645, 0.6710436067037893, 0.5497004779019703);
  const auto number = static_cast<double>(lattice_number(at) + kPoints * (number_of(index) % 4096));
  const glm::vec3 inside = (glm::vec3(at) + glm::vec3(glm::fract(number * step))) / static_cast<float>(kPointsPerEdge);
  return origin_ + (glm::vec3(index) + inside) * edge_m_;
}

}  // namespace earshot
