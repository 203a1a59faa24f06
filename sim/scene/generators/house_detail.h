// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "sim/scene/generators/house_furniture.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Division of two integers below 2^24 is correctly rounded: the same float on every machine.
inline float metres(int millimetres) { return static_cast<float>(millimetres) / 1000.f; }

/// Longest side of a square face whose diagonal is at most `detail_m`, in millimetres; 0 for 0: no limit.
int longest_side_mm(float detail_m);

/// The lines, ascending, with as few more between them as leave no gap wider than `side_mm`; the same for 0.
std::vector<int> subdivided(std::span<const int> lines, int side_mm);

/// Appends a piece with outward normals: a closed surface of its own, its faces subdivided to sides of at most `side_mm` (0: twelve
/// triangles).  Cushions only with side_mm > 0.
void append_furniture(TriangleMesh& mesh, const FurnitureBox& box, int side_mm);

}  // namespace earshot
