// SPDX-License-Identifier: Apache-2.0
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
  /// What was taken off every vertex so that floats resolve them (origin_near): position in the file = vertex + origin_m.
  glm::dvec3 origin_m{0};
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

/// The origin for a mesh within these bounds.  Zero on every axis where the mesh lies within eight times its largest extent of zero: there
/// a float is exact to 1e-6 of that extent.  Beyond, the lower bound rounded down to a whole metre, or to a power of two below the extent
/// of a smaller mesh: a shift by that keeps round coordinates round.
glm::dvec3 origin_near(glm::dvec3 lower, glm::dvec3 upper);

/// Identity of geometry and names, for caches and result files; without the origin: the same room at another place has the same acoustics.
std::uint64_t hash_of(const TriangleMesh& mesh);

}  // namespace earshot
