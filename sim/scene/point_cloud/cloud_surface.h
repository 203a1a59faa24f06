// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/scene/point_cloud/point_voxels.h"
#include "sim/scene/point_cloud/voxel_field.h"

namespace earshot {

/// The border of the air, closed, normals towards the air.
struct CloudSurface {
  std::vector<glm::dvec3> vertices;  ///< relative to PointVoxels::origin_m, in metres
  std::vector<glm::uvec3> triangles;
  std::vector<bool> is_hole;  ///< per triangle: no points were seen there
};

/// Two triangles for each face between an air voxel and another one.  A vertex lies where the planes of its faces meet, least squares
/// (dual contouring: Ju et al. 2002, eq. 1); the plane of a face fits the points within two voxels of it that face the same air.  No vertex
/// crosses half of the solid behind it, so that the two sides of a wall stay apart.  Vertices of closed openings are those of a membrane.
/// About 3 us per face; same labels, same bits.
CloudSurface lay_surface(const PointVoxels& points, const VoxelField& field);

}  // namespace earshot
