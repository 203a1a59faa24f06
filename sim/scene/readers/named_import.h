// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/readers/surface_names.h"

namespace earshot {

/// What import_named_mesh found.
struct NamedMesh {
  ImportedMesh imported;
  bool has_face_ids = false;  ///< faces carry numbers of instances (PLY)
};

/// import_mesh, with names of surfaces: categories become the mesh materials and instances the nodes, where faces carry numbers (PLY) or
/// surfaces carry colours (glTF).  names: null for none.  Throws InputError as import_mesh and `names` do.
NamedMesh import_named_mesh(const std::filesystem::path& path, const MeshImportOptions& options, SurfaceNames* names);

/// Adds a warning for a scene of an unusual size, and for one so far from the origin that `position_step_m`, the spacing of its coordinates
/// in the file, is coarse.
void warn_about_size(const TriangleMesh& mesh, double position_step_m, ImportReport& report);

}  // namespace earshot
