// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>

#include "sim/nav/navmesh.h"

namespace earshot {

/// Where a move ended.
struct MoveResult {
  glm::vec3 position;  ///< on the walkable surface
  bool collided;       ///< the surface stopped or deflected the move: the covered part is shorter than the displacement by more than 1 mm
};

/// Moves along the walkable surface from `from` by `displacement` (horizontal), sliding along borders.  Never leaves the surface;
/// same input, same bits.
MoveResult slide(const Navmesh& navmesh, glm::vec3 from, glm::vec3 displacement);

}  // namespace earshot
