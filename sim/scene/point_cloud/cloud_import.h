// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "sim/scene/point_cloud/point_file.h"
#include "sim/scene/readers/mesh_import.h"

namespace earshot {

/// Reads a point cloud and makes the closed surface of the air that its points enclose: points become voxels, openings are closed, the air
/// within is flooded, and its border is laid on planes that fit the points.  The mesh has one object, named after the file; its materials
/// are named by what a surface is: facing_up, facing_down, upright, and closed_hole where no point was seen.  Its report has a CloudReport.
///
/// options.cell_m: edge of a voxel; without it five times the median spacing of the points, at least 2 cm.  Gaps narrower than two cells
/// are closed, walls need two cells of thickness, and openings are closed up to the smallest width that encloses the air.  Widths are 2,
/// 4, 8, 16, 32, 64 and 124 cells, those above 4 cells only up to kMaxOpeningM.
///
/// Throws InputError: what read_point_file refuses, a point too far from the origin, a cloud that encloses no air, and a cell so small that
/// the voxels exceed their limits (kMaxBlocks, kMaxDenseBlocks: 2 GB).  Same points, same bits; one thread.  9 s of a busy core and 0.45 GB
/// for 2 million points of a house at 5 cm.
ImportedMesh import_point_cloud(const std::filesystem::path& path, const MeshImportOptions& options = {});

}  // namespace earshot
