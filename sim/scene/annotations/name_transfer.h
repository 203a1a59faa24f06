// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Distance, in metres, within which a surface of one mesh is that of another one of the same place.
inline constexpr float kTransferDistanceM = 0.05f;

/// Gives the triangles of `mesh` the material and object names of `named`, another mesh of the same place in the same axes: those of the
/// surface nearest to the middle of the triangle along its normal, within kTransferDistanceM.  Triangles without such a surface become
/// kUnlabelled.  About 2 us per triangle and 1 s per million triangles of `named`.
void transfer_names(const TriangleMesh& named, TriangleMesh& mesh);

}  // namespace earshot
