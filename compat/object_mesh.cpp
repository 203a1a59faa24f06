// SPDX-License-Identifier: Apache-2.0
#include "compat/object_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "compat/call_error.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/mesh/triangle_mesh.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/mesh_file.h"

namespace earshot::compat {
namespace {

constexpr std::size_t kMaxVertices = 0xFFFFFFF0u;

MeshCategory& category_of(ObjectMesh& mesh, const std::string& name) {
  const auto found = std::ranges::find(mesh.categories, name, &MeshCategory::name);
  return found == mesh.categories.end() ? mesh.categories.emplace_back(MeshCategory{name, {}}) : *found;
}

}  // namespace

std::string category_name(const char* text) {
  std::string name = one_line(text == nullptr ? "" : text);
  std::ranges::replace(name, '#', '_');
  name.erase(0, std::min(name.find_first_not_of(' '), name.size()));
  return name.empty() ? "default" : name;
}

ObjectMesh read_object_mesh(const std::filesystem::path& path, const std::string& extension, const char* category) {
  check(fold_case(path.extension().string()) == extension, fmt::format("{}: is no {} file", one_line(path.string()), extension));
  ObjectMesh mesh;
  MeshCategory all{category_name(category), {}};
  for (const MeshPart& part : read_mesh_file(path).parts) {
    check(mesh.positions.size() + part.positions.size() < kMaxVertices, "a mesh of more than 4 billion vertices; simplify it");
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    mesh.positions.insert(mesh.positions.end(), part.positions.begin(), part.positions.end());
    for (const std::uint32_t corner : part.corners) all.corners.push_back(first + corner);
  }
  check(!all.corners.empty(), fmt::format("{}: has no triangles; export the file with its surfaces", one_line(path.string())));
  mesh.categories.push_back(std::move(all));
  return mesh;
}

ObjectMesh make_object_box(glm::dvec3 min, glm::dvec3 max, const RLRA_BoxMaterialCategories* materials) {
  for (int axis = 0; axis < 3; ++axis)
    check(std::isfinite(min[axis]) && std::isfinite(max[axis]) && min[axis] < max[axis],
          fmt::format("a box from {} to {} on axis {}; give a minimum below the maximum", min[axis], max[axis], "xyz"[axis]));
  std::array<const char*, 6> names{};
  if (materials != nullptr) names = {materials->xMin, materials->xMax, materials->yMin, materials->yMax, materials->zMin, materials->zMax};
  TriangleMesh box;
  append_box(box, glm::vec3(0), glm::vec3(1), 0, 0);  // two triangles a face, in this order of faces
  ObjectMesh mesh;
  for (const glm::vec3 corner : box.vertices)
    mesh.positions.emplace_back(corner.x > 0 ? max.x : min.x, corner.y > 0 ? max.y : min.y, corner.z > 0 ? max.z : min.z);
  for (std::size_t face = 0; face < names.size(); ++face)
    for (std::size_t triangle = 2 * face; triangle < 2 * face + 2; ++triangle)
      for (int corner = 0; corner < 3; ++corner)
        category_of(mesh, category_name(names[face])).corners.push_back(box.triangles[triangle][corner]);
  return mesh;
}

void MeshStaging::add_vertices(std::span<const float> positions) {
  check(mesh_.positions.size() + positions.size() / 3 < kMaxVertices, "a mesh of more than 4 billion vertices; simplify it");
  check(std::ranges::all_of(positions, [](float value) { return std::isfinite(value); }), "a vertex is not finite; repair the mesh");
  for (std::size_t i = 0; i + 2 < positions.size(); i += 3) mesh_.positions.emplace_back(positions[i], positions[i + 1], positions[i + 2]);
}

void MeshStaging::add_faces(std::span<const std::uint32_t> indices, std::size_t vertices_per_face, const char* category) {
  check(vertices_per_face == 3 || vertices_per_face == 4, fmt::format("{} vertices per face; give 3 or 4", vertices_per_face));
  if (indices.size() < vertices_per_face) return;
  std::vector<std::uint32_t>& corners = category_of(mesh_, category_name(category)).corners;
  for (std::size_t i = 0; i + vertices_per_face <= indices.size(); i += vertices_per_face)
    for (std::size_t corner = 2; corner < vertices_per_face; ++corner)
      corners.insert(corners.end(), {indices[i], indices[i + corner - 1], indices[i + corner]});
}

ObjectMesh MeshStaging::take() {
  const ObjectMesh mesh = std::exchange(mesh_, {});
  check(!mesh.empty(), "the mesh has no faces; add vertices and indices before it is finalized");
  for (const MeshCategory& category : mesh.categories)
    for (const std::uint32_t corner : category.corners)
      if (corner >= mesh.positions.size())
        throw CallError(RLRA_InvalidParameter,
                        fmt::format("a face of '{}' uses vertex {}, but there are {}", category.name, corner, mesh.positions.size()));
  return mesh;
}

}  // namespace earshot::compat
