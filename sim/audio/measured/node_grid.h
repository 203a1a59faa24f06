// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <glm/vec3.hpp>

namespace earshot {

/// Directions all over the sphere, about 2.5 degrees apart: rows of equal elevation, with as many nodes as the length of the row asks for
/// and one at each pole.  Values at the nodes are interpolated linearly along the two rows next to a direction, and between them; the
/// result is continuous everywhere.  The mirror image of a node is a node.
class NodeGrid {
 public:
  static std::size_t num_nodes();
  /// Unit, head axes (x right, y up, -z front).
  static glm::vec3 direction(std::size_t node);
  struct Place {
    std::array<std::size_t, 4> node;
    std::array<float, 4> weight;  ///< not negative, of sum one
  };
  /// towards: unit.  About 0.1 us.
  static Place find(glm::dvec3 towards);
};

}  // namespace earshot
