// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <span>
#include <string>
#include <vector>

#include "compat/rlr_audio_propagation.h"

namespace earshot::compat {

/// Triangles of one category: three indices each.
struct MeshCategory {
  std::string name;
  std::vector<std::uint32_t> corners;
};

/// Geometry of an object in its own axes and in units of the caller.
struct ObjectMesh {
  std::vector<glm::dvec3> positions;
  std::vector<MeshCategory> categories;  ///< each name once
  [[nodiscard]] bool empty() const { return categories.empty(); }
};

/// The name of a category as the scene and its OBJ file have it: one line, without the marks of a comment; "default" for null and for
/// nothing.
std::string category_name(const char* text);

/// An OBJ or PLY file, all of it of one category.  extension: ".obj" or ".ply", which the file must have.  Throws InputError.
ObjectMesh read_object_mesh(const std::filesystem::path& path, const std::string& extension, const char* category);
/// materials: null for the default material.  Throws CallError unless min is below max on each axis.
ObjectMesh make_object_box(glm::dvec3 min, glm::dvec3 max, const RLRA_BoxMaterialCategories* materials);

/// A mesh that the caller hands over part by part.
class MeshStaging {
 public:
  /// positions: x, y, z of each.  Throws CallError, and adds nothing, for a number that is not finite.
  void add_vertices(std::span<const float> positions);
  /// Cuts faces of four corners into triangles.
  void add_faces(std::span<const std::uint32_t> indices, std::size_t vertices_per_face, const char* category);
  /// What was added, and begins anew.  Throws CallError if there is no face, or an index is out of range.
  ObjectMesh take();

 private:
  ObjectMesh mesh_;
};

}  // namespace earshot::compat
