// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "sim/scene/scene.h"

namespace earshot {

/// How mesh files and point clouds are read: --unit, --up and --cell.
struct AxesOptions {
  std::optional<double> unit_m;   ///< default: from the scene
  std::optional<std::string> up;  ///< y or z; default: from the scene
  std::optional<double> cell_m;   ///< default: from the scene

  void add_to(CLI::App& command);
  [[nodiscard]] std::optional<MeshImportOptions::Up> up_axis() const;
  [[nodiscard]] bool is_given() const { return unit_m || up || cell_m; }
  /// The SCENEs with these choices added to each (mesh_spec.h).  Throws InputError if an option is set and a scene is not a mesh file, or
  /// there is no scene.
  [[nodiscard]] std::vector<std::string> applied_to(std::vector<std::string> scenes) const;
};

/// The options of every command that takes one SCENE.
struct SceneOptions {
  std::string scene;
  AxesOptions axes;
  std::optional<double> simplify_m;

  /// SCENE, --unit, --up and --cell.
  void add_to(CLI::App& command);
  void add_simplify_to(CLI::App& command);
  [[nodiscard]] SceneOverrides overrides() const;
};

}  // namespace earshot
