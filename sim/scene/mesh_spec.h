// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "sim/scene/readers/mesh_import.h"

namespace earshot {

/// A SCENE that names a mesh file or a point cloud, with how it is read: `FILE[,unit=METRES][,up=y|z][,cell=METRES]`.  The part after the
/// comma goes wherever a scene is named, also into episodes and corpora, so that every reader loads the scene in the same way.
struct MeshSpec {
  std::string path;
  std::optional<double> unit_m = std::nullopt;  ///< metres per unit of the file, in [1e-6, 1e6]
  std::optional<MeshImportOptions::Up> up = std::nullopt;
  std::optional<double> cell_m = std::nullopt;  ///< of a point cloud, in [kMinCellM, kMaxCellM]
};

/// Of any SCENE; one that is generated or a scene YAML is its own path.  A file with the whole text as its name takes precedence.  Throws
/// InputError for an unknown key or value after the extension of a mesh.
MeshSpec parse_mesh_spec(const std::string& spec);

/// How a SCENE is read, as the options --unit, --up and --cell give it.
struct MeshChoices {
  std::optional<double> unit_m = std::nullopt;
  std::optional<MeshImportOptions::Up> up = std::nullopt;
  std::optional<double> cell_m = std::nullopt;

  [[nodiscard]] bool is_empty() const { return !unit_m && !up && !cell_m; }
};

/// The SCENE with these choices added.  Throws InputError where it names no mesh file, or makes such a choice itself.
std::string add_mesh_choices(const std::string& spec, const MeshChoices& choices);

}  // namespace earshot
