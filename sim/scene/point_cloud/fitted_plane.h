// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <unordered_map>

#include "sim/scene/point_cloud/point_voxels.h"
#include "sim/scene/point_cloud/voxel_field.h"

namespace earshot {

struct FittedPlane {
  glm::dvec3 normal;  ///< of length one, towards the air
  glm::dvec3 point;   ///< mean of the points, relative to PointVoxels::origin_m
};

/// Fits planes to the points behind faces of air voxels.  Keeps references.
class PlaneFinder {
 public:
  PlaneFinder(const PointVoxels& points, const VoxelField& field);

  /// The plane of the points near the face between `solid` and the air voxel solid - step; step: a unit vector of an axis.  nullopt where
  /// they are too few, make no plane, or make one that the face does not look at.
  [[nodiscard]] std::optional<FittedPlane> plane_at(glm::ivec3 solid, glm::ivec3 step) const;

 private:
  [[nodiscard]] const VoxelPoints* points_in(glm::ivec3 voxel) const;

  const PointVoxels& points_;
  const VoxelField& field_;
  std::unordered_map<std::uint64_t, std::uint32_t> index_;
};

}  // namespace earshot
