// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Per triangle: 1 where it belongs to a closed surface that is wound outward, and so bounds a body, not a room.  A surface is what joins
/// at edges, whatever its materials; it is closed where each edge is passed as often in one direction as in the other, and wound outward
/// where the volume within is positive.  Vertices closer than a tenth of a millimetre are one.  Cost: a sort of the edges.
std::vector<std::uint8_t> bounds_of_bodies(const TriangleMesh& mesh);

}  // namespace earshot
