// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/name_transfer.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <string>
#include <vector>

#include "sim/rays/embree_scene.h"
#include "sim/scene/annotations/annotations.h"

namespace earshot {
namespace {

/// Rays start off the surface: one that starts on it may miss it.
constexpr float kStartM = 1e-3f;

/// The triangle nearest to a point along a unit normal, to both sides.
std::uint32_t nearest_along(const EmbreeScene& rays, glm::vec3 point, glm::vec3 normal) {
  std::uint32_t nearest = Hit::no_triangle;
  float nearest_m = kTransferDistanceM;
  for (const float side : {1.f, -1.f}) {
    const Hit hit = rays.intersect(point + side * kStartM * normal, -side * normal, kStartM + kTransferDistanceM);
    const float apart_m = std::fabs(hit.distance_m - kStartM);
    if (!hit.valid() || !(apart_m < nearest_m)) continue;
    nearest_m = apart_m;
    nearest = hit.triangle;
  }
  return nearest;
}

}  // namespace

void transfer_names(const TriangleMesh& named, TriangleMesh& mesh) {
  std::vector<glm::vec3> vertices;
  vertices.reserve(named.vertices.size());
  for (const glm::vec3 vertex : named.vertices) vertices.emplace_back(glm::dvec3(vertex) + named.origin_m - mesh.origin_m);
  const EmbreeScene rays(vertices, named.triangles);
  mesh.material_names = named.material_names;
  mesh.object_names = named.object_names;
  const std::uint32_t no_material = intern(mesh.material_names, std::string(kUnlabelled)),
                      no_object = intern(mesh.object_names, std::string(kUnlabelled));
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const glm::vec3 a = mesh.vertices[mesh.triangles[t].x], b = mesh.vertices[mesh.triangles[t].y], c = mesh.vertices[mesh.triangles[t].z];
    const glm::dvec3 normal = glm::normalize(glm::cross(glm::dvec3(b) - glm::dvec3(a), glm::dvec3(c) - glm::dvec3(a)));
    const std::uint32_t nearest = nearest_along(rays, (a + b + c) / 3.f, normal);
    const bool is_found = nearest != Hit::no_triangle;
    mesh.triangle_material[t] = is_found ? named.triangle_material[nearest] : no_material;
    mesh.triangle_object[t] = is_found ? named.triangle_object[nearest] : no_object;
  }
}

}  // namespace earshot
