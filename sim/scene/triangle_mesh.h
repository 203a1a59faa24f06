#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

namespace earshot {

/// An indexed triangle mesh in metres, right-handed, y up.  One entry per triangle in every triangle_* array.
struct TriangleMesh {
  std::vector<glm::vec3> vertices;
  std::vector<glm::uvec3> triangles;
  std::vector<std::uint32_t> triangle_material;  ///< index into material_names
  std::vector<std::uint32_t> triangle_object;    ///< index into object_names
  std::vector<std::string> material_names;       ///< as in the file; materials of Earshot are assigned to these by name
  std::vector<std::string> object_names;         ///< node names, or the generator's object names ("table_3")
};

/// Axis-aligned bounds; for an empty mesh lower > upper.
struct Bounds {
  glm::vec3 lower, upper;
};
Bounds bounds_of(const TriangleMesh& mesh);

/// Appends an axis-aligned box with outward normals (12 triangles).  lower < upper per axis.
void append_box(TriangleMesh& mesh, glm::vec3 lower, glm::vec3 upper, std::uint32_t material, std::uint32_t object);

/// Index of `name` in `names`, appended if new.
std::uint32_t intern(std::vector<std::string>& names, const std::string& name);

/// Identity of geometry and names, for caches and result files.
std::uint64_t hash_of(const TriangleMesh& mesh);

}  // namespace earshot
