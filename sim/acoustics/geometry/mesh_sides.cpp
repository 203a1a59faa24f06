// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/mesh_sides.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <numeric>

namespace earshot {
namespace {

/// For each vertex the first one, in the order of coordinates, at the same position.
std::vector<std::uint32_t> weld(const std::vector<glm::vec3>& vertices) {
  std::vector<std::uint32_t> order(vertices.size()), first(vertices.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const glm::vec3 p = vertices[a], q = vertices[b];
    return p.x != q.x ? p.x < q.x : p.y != q.y ? p.y < q.y : p.z != q.z ? p.z < q.z : a < b;
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    first[order[i]] = i > 0 && vertices[order[i]] == vertices[order[i - 1]] ? first[order[i - 1]] : order[i];
  }
  return first;
}

}  // namespace

std::vector<MeshSide> sorted_sides(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> first = weld(mesh.vertices);
  std::vector<MeshSide> sides;
  sides.reserve(3 * mesh.triangles.size());
  for (std::uint32_t triangle = 0; triangle < mesh.triangles.size(); ++triangle) {
    const glm::uvec3 corner = mesh.triangles[triangle];
    for (int i = 0; i < 3; ++i) {
      const std::uint32_t a = first[corner[i]], b = first[corner[(i + 1) % 3]];
      if (a == b) continue;
      sides.push_back({std::uint64_t{std::min(a, b)} << 32 | std::max(a, b), triangle, corner[(i + 2) % 3]});
    }
  }
  std::sort(sides.begin(), sides.end(),
            [](const MeshSide& a, const MeshSide& b) { return a.key != b.key ? a.key < b.key : a.triangle < b.triangle; });
  return sides;
}

bool meets_front(const TriangleMesh& mesh, std::uint32_t triangle, glm::vec3 direction) {
  const glm::uvec3 corners = mesh.triangles[triangle];
  const glm::dvec3 first = mesh.vertices[corners.x], second = mesh.vertices[corners.y], third = mesh.vertices[corners.z];
  return glm::dot(glm::cross(second - first, third - first), glm::dvec3(direction)) < 0;
}

}  // namespace earshot
