// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <glm/mat4x4.hpp>
#include <optional>

#include "sim/scene/mesh/import_report.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Bounds of the voxels of point clouds, in metres.
inline constexpr double kMinCellM = 0.001, kMaxCellM = 10;

/// How the coordinates of a mesh file or a point cloud are read.
struct MeshImportOptions {
  enum class Up { y, z };
  Up up = Up::y;      ///< axis that points up in the file; z is turned to y, right-handed: (x, y, z) -> (x, z, -y)
  double unit_m = 1;  ///< metres per unit of the file, above 0
  /// Edge of the voxels of a point cloud in metres, in [kMinCellM, kMaxCellM]; nullopt: from the spacing of its points.  Meshes take none.
  std::optional<double> cell_m = std::nullopt;
};

/// From the coordinates of the file to metres, y up.
glm::dmat4 file_to_world(const MeshImportOptions& options);

struct ImportedMesh {
  TriangleMesh mesh;
  ImportReport report;
};

/// Whether `path` has the extension of a mesh (glb, gltf, obj, ply, stl) or of a point cloud (pcd, xyz, pts, asc, las, laz), in any case.
bool is_mesh_file(const std::filesystem::path& path);

/// Whether `path` has the extension of a format that holds points alone.
bool has_cloud_extension(const std::filesystem::path& path);

/// Reads a mesh file, bakes all node transforms (in double), cuts polygons into triangles, keeps material and node names, and repairs
/// (mesh_repair.h).  Every face of the file becomes triangles or an error; points and lines are dropped, other things that are left out are
/// named in the warnings of the report.  Skinned meshes come in their bind pose.  A mesh far from the
/// origin is moved near it before its coordinates become floats (TriangleMesh::origin_m; text and doubles keep all their digits); where the
/// file itself holds floats that are too coarse for the size of the mesh, there is a warning.  About 0.2 s per 100,000 triangles.
/// Throws InputError: missing file, unknown extension, not parsable, vertex NaN or infinite (with its index), index out of range,
/// no triangles.
ImportedMesh import_mesh(const std::filesystem::path& path, const MeshImportOptions& options = {});

}  // namespace earshot
