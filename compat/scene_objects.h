// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "compat/object_mesh.h"
#include "sim/scene/materials/materials.h"
#include "sim/scene/scene.h"

namespace earshot::compat {

/// An object: its geometry and where it stands, in units of the caller.
struct SceneObject {
  ObjectMesh mesh;
  glm::dvec3 position{0};
  glm::dquat orientation{1, 0, 0, 0};  ///< own axes to world; unit
};

/// How objects become a scene.
struct SceneRules {
  double unit_m = 1;
  std::optional<float> simplify_m;
  const MaterialDatabase* database = nullptr;  ///< null: the built-in one
};

/// The scene of all objects in their places: an object name and a category for each triangle, materials by category.  With a database the
/// category takes the material with the most labels that occur in it, else the one labelled "default", else the built-in default; without
/// one, categories are looked up in the built-in materials as names of a mesh file are.  Null if no object has a triangle with an area.
/// Throws InputError, as import_mesh.
std::shared_ptr<const Scene> make_scene(const std::vector<SceneObject>& objects, const SceneRules& rules);

/// Text of an OBJ file that a reader turns into the mesh of `scene` again, bit for bit.  Vertices have a colour by the category of their
/// triangles.  scene: null for none.
std::string scene_obj(const Scene* scene);

}  // namespace earshot::compat
