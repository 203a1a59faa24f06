// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>
#include <span>
#include <utility>
#include <vector>

namespace earshot {

/// Interpolates what is known in some directions to any other, as a sum with weights: ordinary kriging (Matheron 1963) with the variogram
/// h^1.3 of the chord h, the best of those tried on two measured heads (docs/evidence/heads.md).  It has no length scale, is exact in the
/// known directions, and a direction that stands alone counts more than each of a crowd.  Immutable, thread-safe.
class DirectionWeights {
 public:
  /// Neighbours that count.
  static constexpr std::size_t kNeighbours = 32;
  /// directions: unit, no two alike, at least one.
  explicit DirectionWeights(std::span<const glm::vec3> directions);
  struct Weight {
    std::size_t direction;
    double weight;
  };
  /// Weights of the nearest directions, which add up to one; some are negative.  About 40 us for 1,500 directions.
  [[nodiscard]] std::vector<Weight> at(glm::vec3 towards) const;

 private:
  std::vector<glm::dvec3> directions_;
};

}  // namespace earshot
