// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// A group of coplanar triangles, connected or not, of either facing: the mirror of an image source.
struct MirrorPlane {
  glm::vec3 normal;        ///< unit; the facing of the largest triangle
  float offset_m;          ///< dot(normal, x) on the plane
  float area_m2;           ///< of all triangles on it
  std::uint32_t material;  ///< slot with the largest area on it
  Bounds bounds;           ///< of all triangles on it, widened by the tolerance of the grouping

  /// Does a point of the plane lie within the bounds?  Where it does not, no triangle of the plane is.
  [[nodiscard]] bool bounds_hold(glm::dvec3 p) const {
    return p.x >= bounds.lower.x && p.y >= bounds.lower.y && p.z >= bounds.lower.z &&  //
           p.x <= bounds.upper.x && p.y <= bounds.upper.y && p.z <= bounds.upper.z;
  }
};

struct MirrorPlanes {
  std::vector<MirrorPlane> planes;               ///< in the order of their largest triangle, largest first
  std::vector<std::uint32_t> plane_of_triangle;  ///< one entry per triangle of the mesh
};

/// Groups triangles whose normals differ by at most 0.5 degrees and whose centroids lie within 1 mm + 1e-5 of the scene's diagonal of
/// the plane (1e-4 of the diagonal if that is less, so that tiny scenes keep their walls apart).  Both facings join one plane.
/// About 1 us per triangle; deterministic.
MirrorPlanes find_mirror_planes(const TriangleMesh& mesh);

}  // namespace earshot
