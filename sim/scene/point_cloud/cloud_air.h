// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "sim/scene/point_cloud/point_voxels.h"
#include "sim/scene/point_cloud/voxel_field.h"

namespace earshot {

/// Openings are closed up to this width in metres, and up to four cells if that is more.
inline constexpr double kMaxOpeningM = 2;

/// Empty voxels that find_cloud_air needs around the points.
int air_margin(double cell_m);

/// What was found around the points of a cloud.
struct CloudAir {
  double closed_width_m = 0;  ///< openings up to this width were closed
  std::uint64_t holes = 0;    ///< places where nine air voxels or more meet what is outside or was not seen
  std::uint64_t unseen = 0;   ///< voxels that are neither air nor outside nor solid
};

/// Labels the voxels of a cloud.  Voxels with points, and gaps between them too narrow for two voxels, are solid.  For a number of widths
/// up to kMaxOpeningM everything within half the width of a solid voxel is closed, and the rest flooded from outside; enclosed parts where
/// a ball of 0.45 m fits are rooms (without any, those where one of four voxels fits).  Then rooms and outside grow back to the surfaces,
/// from wide places to narrow ones, so that they meet within the openings.  The smallest width that gives 98 % of the most air is taken.
/// Throws InputError if no width encloses air.  Some 20 ns per voxel near a surface and width.
CloudAir find_cloud_air(const PointVoxels& points, VoxelField& field, const std::string& where);

}  // namespace earshot
