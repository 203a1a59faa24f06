// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/mirror_planes.h"

namespace earshot {

/// Surfaces of two planes and more that are folded little: a wave much longer than the fold is deep is reflected as by one plane.
struct FoldedPlanes {
  std::vector<MirrorPlane> planes;        ///< through the middle of each, largest first; bounds: of all its triangles, widened by its depth
  std::vector<float> depth_m;             ///< of each, from its highest to its lowest vertex
  std::vector<std::uint32_t> some_plane;  ///< of each: one of the mirror planes in it, the largest
  std::vector<std::uint32_t> fold_of_triangle;  ///< planes.size(): not in a fold; empty without any fold
};

/// Joins triangles across the sides that two of them share at less than 15 degrees from flat.  A connected group is a fold if it is at
/// most `deepest_m` deep and no triangle leans by 15 degrees from its mean; otherwise, as round a column or in a scanned room, all of it
/// stays as it is.  About 0.5 us per triangle.
FoldedPlanes find_folded_planes(const TriangleMesh& mesh, const MirrorPlanes& mirrors, double deepest_m);

}  // namespace earshot
