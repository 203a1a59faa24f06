// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "sim/scene/habitat/placement.h"

namespace earshot {

/// A mesh file in a scene.
struct PlacedAsset {
  std::filesystem::path mesh;
  Placement placement;
  std::string name;                                        ///< of an object: its template and its number in the scene, "chair_12"
  std::optional<std::int64_t> semantic_id = std::nullopt;  ///< of an object
};

/// A scene of Habitat: a stage with objects, as mesh files.
struct HabitatScene {
  PlacedAsset stage;
  std::vector<PlacedAsset> objects;
  /// The mesh of the stage that carries numbers or colours, and the file of annotations that names them.
  std::optional<std::filesystem::path> semantic_mesh, descriptor;
  std::vector<std::filesystem::path> files;  ///< JSON files that were read
  std::vector<std::string> warnings;         ///< one line each
};

/// Whether a SCENE is `X.scene_instance.json` or `X.scene_dataset_config.json[,scene=HANDLE]`, by its name.
bool is_habitat_scene(std::string_view spec);

/// Reads the JSON files of a scene; meshes are not read.  A scene instance belongs to the `*.scene_dataset_config.json` in its folder or
/// in one of the folders above that lists it.  A config without a HANDLE must list one scene, or no scene and one stage; HANDLE is a scene
/// instance or a stage.
/// Throws InputError naming file and key: missing, damaged, out of range, a handle that is not listed or not unique, a path out of the
/// folder of the data set, what has no public description.
HabitatScene read_habitat_scene(const std::string& spec);

/// Names of the classes in a JSON descriptor by id; empty for one without `classes`.  Throws InputError: damaged, an id that occurs twice.
std::map<std::int64_t, std::string> read_classes(const std::filesystem::path& descriptor);

}  // namespace earshot
