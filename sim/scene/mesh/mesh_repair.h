// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/scene/mesh/import_report.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// For each vertex the index of the first vertex within `tolerance_m` of it (itself if none).  tolerance 0: equal positions only.
/// O(n) by a grid of cells; the result depends on the order of the vertices alone.
std::vector<std::uint32_t> weld_map(std::span<const glm::vec3> vertices, float tolerance_m);

/// The same with a tolerance per vertex: two are one if their distance is within both tolerances.  At most 21 grids of cells.
std::vector<std::uint32_t> weld_map(std::span<const glm::vec3> vertices, std::span<const float> tolerance_m);

/// Welds vertices closer than 1e-6 of the diagonal of the bounds (rounding of baked node transforms; ten times the spacing of floats), but
/// never farther apart than a tenth of the longest edge of a triangle there,
/// then removes triangles without area and triangles on the same three vertices as an earlier one (either winding: a surface is
/// two-sided for sound, and a doubled one would transmit twice), then unused vertices.  Adds to the counts of the report.
void repair_mesh(TriangleMesh& mesh, ImportReport& report);

}  // namespace earshot
