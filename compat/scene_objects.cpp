// SPDX-License-Identifier: Apache-2.0
#include "compat/scene_objects.h"

#include <fmt/format.h>

#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>
#include <iterator>
#include <unordered_map>
#include <utility>

#include "sim/base/random.h"
#include "sim/scene/materials/material_assignment.h"
#include "sim/scene/mesh/mesh_repair.h"
#include "sim/scene/mesh/mesh_simplify.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot::compat {
namespace {

constexpr const char* kSceneName = "RLRA context";

/// From an object's own axes and units to metres of the world.
glm::dmat4 object_to_world(const SceneObject& object, double unit_m) {
  const glm::dmat3 scaled_rotation = unit_m * glm::mat3_cast(object.orientation);
  glm::dmat4 matrix(scaled_rotation);
  matrix[3] = glm::dvec4(unit_m * object.position, 1);
  return matrix;
}

void append_category(const ObjectMesh& mesh, const MeshCategory& category, const std::string& object, const glm::dmat4& to_world,
                     MeshBuilder& builder) {
  std::unordered_map<std::uint32_t, std::uint32_t> index_of;
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> corners;
  corners.reserve(category.corners.size());
  for (const std::uint32_t corner : category.corners) {
    const auto [found, is_new] = index_of.try_emplace(corner, static_cast<std::uint32_t>(positions.size()));
    if (is_new) positions.push_back(mesh.positions[corner]);
    corners.push_back(found->second);
  }
  builder.append(object, category.name, to_world, positions, corners, PositionDigits::floats);
}

/// Of each mesh material, by the labels of the caller's database.
std::vector<std::optional<Material>> labelled_materials(const std::vector<std::string>& categories, const MaterialDatabase& database) {
  const MaterialDatabase builtin = MaterialDatabase::builtin();
  const Material* fallback = database.find_label("default");
  if (fallback == nullptr) fallback = builtin.find_label("default");
  std::vector<std::optional<Material>> materials;
  for (const std::string& category : categories) {
    const Material* found = database.find_by_substrings(category);
    materials.emplace_back(found != nullptr ? *found : *fallback);
  }
  return materials;
}

glm::vec3 color_of(std::uint32_t slot) {
  const RandomStream random(0, Purpose::material, slot);
  return {random.uniform(0), random.uniform(1), random.uniform(2)};
}

}  // namespace

std::shared_ptr<const Scene> make_scene(const std::vector<SceneObject>& objects, const SceneRules& rules) {
  TriangleMesh mesh;
  MeshBuilder builder(kSceneName, mesh);
  for (std::size_t i = 0; i < objects.size(); ++i)
    for (const MeshCategory& category : objects[i].mesh.categories)
      append_category(objects[i].mesh, category, fmt::format("{}", i), object_to_world(objects[i], rules.unit_m), builder);
  builder.finish();
  ImportReport report;
  report.triangles_read = mesh.triangles.size();
  repair_mesh(mesh, report);
  if (mesh.triangles.empty()) return nullptr;
  if (rules.simplify_m) report.simplified = simplify_mesh(mesh, *rules.simplify_m);
  const MaterialDatabase builtin = MaterialDatabase::builtin();
  std::vector<std::optional<Material>> slot_materials(mesh.material_names.size());
  if (rules.database != nullptr) slot_materials = labelled_materials(mesh.material_names, *rules.database);
  std::vector<Material> materials =
      assign_materials(mesh, MaterialRules{}, builtin, slot_materials, kSceneName, report.warnings, &report.choices);
  return std::make_shared<const Scene>(kSceneName, std::move(mesh), std::move(materials), Air{}, std::move(report));
}

std::string scene_obj(const Scene* scene) {
  std::string text = "# metres, y up\n";
  if (scene == nullptr) return text;
  const TriangleMesh& mesh = scene->mesh();
  constexpr std::uint32_t none = 0xFFFFFFFFu;
  std::uint32_t object = none, slot = none;
  std::size_t num_written = 0;
  std::unordered_map<std::uint32_t, std::size_t> number_of;  // within a run of one object and category, from one
  const auto out = std::back_inserter(text);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.triangle_object[t] != object || mesh.triangle_material[t] != slot) {
      object = mesh.triangle_object[t];
      slot = mesh.triangle_material[t];
      number_of.clear();
      fmt::format_to(out, "o {}\nusemtl {}\n", mesh.object_names[object], mesh.material_names[slot]);
    }
    const glm::vec3 color = color_of(slot);
    for (glm::length_t c = 0; c < 3; ++c) {
      const auto [number, is_new] = number_of.try_emplace(mesh.triangles[t][c], num_written + 1);
      if (!is_new) continue;
      ++num_written;
      const glm::dvec3 place = scene->to_world(mesh.vertices[number->first]);
      fmt::format_to(out, "v {} {} {} {:.3f} {:.3f} {:.3f}\n", place.x, place.y, place.z, color.x, color.y, color.z);
    }
    const glm::uvec3 corners = mesh.triangles[t];
    fmt::format_to(out, "f {} {} {}\n", number_of[corners.x], number_of[corners.y], number_of[corners.z]);
  }
  return text;
}

}  // namespace earshot::compat
