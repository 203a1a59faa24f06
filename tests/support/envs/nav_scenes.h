// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <glm/vec3.hpp>
#include <initializer_list>

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Two upward triangles.
inline void append_floor(TriangleMesh& mesh, float x0, float z0, float x1, float z1, float y = 0) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), {{x0, y, z0}, {x0, y, z1}, {x1, y, z1}, {x1, y, z0}});
  for (const glm::uvec3 t : {glm::uvec3{0, 1, 2}, glm::uvec3{0, 2, 3}}) {
    mesh.triangles.push_back(t + glm::uvec3(first));
    mesh.triangle_material.push_back(intern(mesh.material_names, "floor"));
    mesh.triangle_object.push_back(intern(mesh.object_names, "floor_0"));
  }
}

/// A box that stands on (and a little in) a floor at y = 0; lower than the agent, for Recast sees faces, not solids: an agent could
/// stand inside a higher one.
inline void append_block(TriangleMesh& mesh, float x0, float z0, float x1, float z1, float height = 1.4f, float bottom = -0.01f) {
  append_box(mesh, {x0, bottom, z0}, {x1, height, z1}, intern(mesh.material_names, "block"), intern(mesh.object_names, "block_0"));
}

/// A floor from (0, 0) to (width, depth) with blocks on it, each {x0, z0, x1, z1}.
struct Block {
  float x0, z0, x1, z1;
};
inline TriangleMesh floor_with(float width, float depth, std::initializer_list<Block> blocks) {
  TriangleMesh mesh;
  append_floor(mesh, 0, 0, width, depth);
  for (const Block& b : blocks) append_block(mesh, b.x0, b.z0, b.x1, b.z1);
  return mesh;
}

inline float flat_distance(glm::vec3 a, glm::vec3 b) { return std::hypot(a.x - b.x, a.z - b.z); }

}  // namespace earshot
