#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "sim/scene/scene.h"

namespace earshot {

/// The options of every command that takes a SCENE.
struct SceneOptions {
  std::string scene;
  std::optional<double> unit_m;   ///< default: what the scene says
  std::optional<std::string> up;  ///< y or z; default: what the scene says
  std::optional<double> simplify_m;

  /// SCENE, --unit and --up.
  void add_to(CLI::App& command);
  void add_simplify_to(CLI::App& command);
  [[nodiscard]] SceneOverrides overrides() const;
};

}  // namespace earshot
