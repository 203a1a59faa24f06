// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "sim/scene/mesh/import_report.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Collapses edges of the mesh (quadric errors of Garland and Heckbert 1997, meshoptimizer) while its surface stays within
/// `deviation_m` of where it was, as measured on the vertices that go (see below).  Every (material, object) is simplified for itself with
/// its border held fixed, so that no gap opens between neighbours and no triangle changes its material.  Detail far below the
/// wavelength (17 cm at 2 kHz) changes no sound: 0.01 m is a cautious choice. Throws InputError if deviation_m is not in (0, 1].  About 2
/// us per triangle; deterministic.
/// first_target_m: the quadric error that is tried first, at most deviation_m; without it deviation_m.
SimplifyReport simplify_mesh(TriangleMesh& mesh, float deviation_m, std::optional<float> first_target_m = std::nullopt);

/// Distance of a point from a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
double distance_to_triangle(glm::dvec3 point, glm::dvec3 a, glm::dvec3 b, glm::dvec3 c);

}  // namespace earshot
