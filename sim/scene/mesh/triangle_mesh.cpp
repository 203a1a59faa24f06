// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/triangle_mesh.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <limits>
#include <span>

#include "sim/base/errors.h"
#include "sim/base/files.h"

namespace earshot {
namespace {

template <class T>
std::uint64_t hash_array(const std::vector<T>& values, std::uint64_t seed) {
  const std::uint64_t count = values.size();
  seed = hash64(std::as_bytes(std::span(&count, 1)), seed);
  return hash64(std::as_bytes(std::span(values)), seed);
}

std::uint64_t hash_names(const std::vector<std::string>& names, std::uint64_t seed) {
  const std::uint64_t count = names.size();
  seed = hash64(std::as_bytes(std::span(&count, 1)), seed);
  for (const std::string& name : names) seed = hash64(name, seed);
  return seed;
}

}  // namespace

Bounds bounds_of(const TriangleMesh& mesh) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  Bounds bounds{glm::vec3(infinity), glm::vec3(-infinity)};
  for (const glm::uvec3 triangle : mesh.triangles) {
    for (int corner = 0; corner < 3; ++corner) {
      const glm::vec3 vertex = mesh.vertices[triangle[corner]];
      bounds.lower = glm::min(bounds.lower, vertex);
      bounds.upper = glm::max(bounds.upper, vertex);
    }
  }
  return bounds;
}

void append_box(TriangleMesh& mesh, glm::vec3 lower, glm::vec3 upper, std::uint32_t material, std::uint32_t object) {
  EARSHOT_EXPECT(lower.x < upper.x && lower.y < upper.y && lower.z < upper.z);
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (unsigned corner = 0; corner < 8; ++corner) {  // bits 0, 1, 2 choose the upper x, y, z
    mesh.vertices.emplace_back(corner & 1u ? upper.x : lower.x, corner & 2u ? upper.y : lower.y, corner & 4u ? upper.z : lower.z);
  }
  constexpr glm::uvec3 faces[12] = {{0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5},   // x lower, x upper
                                    {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},   // y
                                    {0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}};  // z
  for (const glm::uvec3 face : faces) {
    mesh.triangles.push_back(face + glm::uvec3(first));
    mesh.triangle_material.push_back(material);
    mesh.triangle_object.push_back(object);
  }
}

std::uint32_t intern(std::vector<std::string>& names, const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    names.push_back(name);
    return static_cast<std::uint32_t>(names.size() - 1);
  }
  return static_cast<std::uint32_t>(found - names.begin());
}

glm::dvec3 origin_near(glm::dvec3 lower, glm::dvec3 upper) {
  constexpr double far = 8;  // times 2^-23, the spacing of floats, is 1e-6
  const glm::dvec3 size = upper - lower;
  const double largest_m = std::max({size.x, size.y, size.z});
  glm::dvec3 origin(0);
  if (!(largest_m > 0 && std::isfinite(largest_m))) return origin;
  const double step_m = std::min(1.0, std::exp2(std::floor(std::log2(largest_m))));
  for (int axis = 0; axis < 3; ++axis) {
    if (std::max(std::fabs(lower[axis]), std::fabs(upper[axis])) > far * largest_m)
      origin[axis] = std::floor(lower[axis] / step_m) * step_m;
  }
  return origin;
}

std::uint64_t hash_of(const TriangleMesh& mesh) {
  std::uint64_t hash = hash_array(mesh.vertices, 0);
  hash = hash_array(mesh.triangles, hash);
  hash = hash_array(mesh.triangle_material, hash);
  hash = hash_array(mesh.triangle_object, hash);
  hash = hash_names(mesh.material_names, hash);
  return hash_names(mesh.object_names, hash);
}

}  // namespace earshot
