// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// A side of a triangle by its two vertices, of which those at equal positions count as one.
struct MeshSide {
  std::uint64_t key;                 ///< the lower vertex times 2^32, and the higher
  std::uint32_t triangle, opposite;  ///< opposite: the triangle's third vertex
  [[nodiscard]] std::uint32_t low() const { return static_cast<std::uint32_t>(key >> 32); }
  [[nodiscard]] std::uint32_t high() const { return static_cast<std::uint32_t>(key); }
};

/// All sides of a mesh, those between the same vertices in a row, by triangle.  About 0.3 us per triangle.
std::vector<MeshSide> sorted_sides(const TriangleMesh& mesh);

/// Does a ray meet the front of a triangle, the side from which its vertices run counter-clockwise?
bool meets_front(const TriangleMesh& mesh, std::uint32_t triangle, glm::vec3 direction);

/// Calls `visit` with each run of sides between the same two vertices.
template <typename Visit>
void for_each_joint(std::span<const MeshSide> sides, const Visit& visit) {
  for (std::size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
    while (end < sides.size() && sides[end].key == sides[begin].key) ++end;
    visit(sides.subspan(begin, end - begin));
  }
}

}  // namespace earshot
