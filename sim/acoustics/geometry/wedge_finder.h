// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <numbers>
#include <vector>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Edges turn sound from 5 degrees past a flat wall on.
inline constexpr double kMinExteriorRad = std::numbers::pi + 5.0 * (std::numbers::pi / 180.0);

/// The wedges of a mesh by adjacency alone, straight runs merged, at least `least_length_m` long; longest first.  Faces that touch an edge
/// without sharing its vertices are not found here.
std::vector<DiffractionEdge> find_wedges(const TriangleMesh& mesh, double least_length_m);

}  // namespace earshot
