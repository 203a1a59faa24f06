// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <string>
#include <vector>

#include "sim/base/random.h"
#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/scene.h"
#include "tests/support/files/gltf_files.h"
#include "tests/support/files/test_files.h"

/// Meshes in double, and the files that hold them: knows nothing of the readers.
namespace earshot::mesh_cases {

struct DoubleMesh {
  std::vector<glm::dvec3> vertices;
  std::vector<glm::uvec3> triangles;
};

/// A closed box with shared vertices, its lower corner at `at`.
inline DoubleMesh box(glm::dvec3 size_m, glm::dvec3 at = glm::dvec3(0)) {
  DoubleMesh mesh;
  for (unsigned corner = 0; corner < 8; ++corner)
    mesh.vertices.push_back(at + glm::dvec3(corner & 1u ? size_m.x : 0, corner & 2u ? size_m.y : 0, corner & 4u ? size_m.z : 0));
  mesh.triangles = {{0, 6, 4}, {0, 2, 6}, {1, 7, 3}, {1, 5, 7}, {0, 5, 1}, {0, 4, 5},
                    {2, 7, 6}, {2, 3, 7}, {0, 3, 2}, {0, 1, 3}, {4, 7, 5}, {4, 6, 7}};
  return mesh;
}

inline std::string obj_text(const DoubleMesh& mesh) {
  std::string text = "o room\nusemtl wall\n";
  for (const glm::dvec3 v : mesh.vertices) text += fmt::format("v {} {} {}\n", v.x, v.y, v.z);
  for (const glm::uvec3 t : mesh.triangles) text += fmt::format("f {} {} {}\n", t.x + 1, t.y + 1, t.z + 1);
  return text;
}

enum class PlyBody { text, floats, floats_big_endian, doubles, doubles_big_endian };

inline std::string ply_file(const DoubleMesh& mesh, PlyBody body) {
  const bool text = body == PlyBody::text, big = body == PlyBody::floats_big_endian || body == PlyBody::doubles_big_endian;
  const bool doubles = body == PlyBody::doubles || body == PlyBody::doubles_big_endian;
  const char* type = doubles || text ? "double" : "float";
  std::string bytes = fmt::format(
      "ply\nformat {} 1.0\nelement vertex {}\nproperty {} x\nproperty {} y\nproperty {} z\nelement face {}\n"
      "property list uchar int vertex_indices\nend_header\n",
      text  ? "ascii"
      : big ? "binary_big_endian"
            : "binary_little_endian",
      mesh.vertices.size(), type, type, type, mesh.triangles.size());
  const auto append = [&](auto value) {
    auto raw = std::bit_cast<std::array<char, sizeof value>>(value);
    if (big) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.data(), raw.size());
  };
  for (const glm::dvec3 v : mesh.vertices) {
    if (text) {
      bytes += fmt::format("{} {} {}\n", v.x, v.y, v.z);
      continue;
    }
    for (int axis = 0; axis < 3; ++axis) {
      if (doubles)
        append(v[axis]);
      else
        append(static_cast<float>(v[axis]));
    }
  }
  for (const glm::uvec3 t : mesh.triangles) {
    if (text) {
      bytes += fmt::format("3 {} {} {}\n", t.x, t.y, t.z);
      continue;
    }
    bytes.push_back(3);
    for (int corner = 0; corner < 3; ++corner) append(t[corner]);
  }
  return bytes;
}

inline std::string stl_text(const DoubleMesh& mesh) {
  std::string text = "solid room\n";
  for (const glm::uvec3 t : mesh.triangles) {
    text += "facet normal 0 0 0\nouter loop\n";
    for (int corner = 0; corner < 3; ++corner) {
      const glm::dvec3 v = mesh.vertices[t[corner]];
      text += fmt::format("vertex {} {} {}\n", v.x, v.y, v.z);
    }
    text += "endloop\nendfacet\n";
  }
  return text + "endsolid room\n";
}

inline std::string stl_binary(const DoubleMesh& mesh) {
  std::string bytes(80, '\0');
  const auto append = [&](auto value) {
    const auto raw = std::bit_cast<std::array<char, sizeof value>>(value);
    bytes.append(raw.data(), raw.size());
  };
  append(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const glm::uvec3 t : mesh.triangles) {
    for (int i = 0; i < 3; ++i) append(0.f);
    for (int corner = 0; corner < 3; ++corner)
      for (int axis = 0; axis < 3; ++axis) append(static_cast<float>(mesh.vertices[t[corner]][axis]));
    bytes.append(2, '\0');
  }
  return bytes;
}

/// Float positions as glTF has them, under two nested nodes whose translations add up to `translation`.
inline std::string gltf_file(const DoubleMesh& mesh, glm::dvec3 translation = glm::dvec3(0)) {
  GltfWriter file;
  std::vector<float> xyz;
  for (const glm::dvec3 v : mesh.vertices)
    for (int axis = 0; axis < 3; ++axis) xyz.push_back(static_cast<float>(v[axis]));
  std::vector<std::uint32_t> corners;
  for (const glm::uvec3 t : mesh.triangles) corners.insert(corners.end(), {t.x, t.y, t.z});
  const std::size_t positions = file.add_positions(xyz),
                    indices = file.add_accessor(file.add_view(corners), corners.size(), 5125, "SCALAR");
  file.json["materials"] = {{{"name", "wall"}}};
  file.json["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", positions}}}, {"indices", indices}, {"material", 0}}}}}};
  const glm::dvec3 outer = 2.0 * translation, inner = -translation;
  file.json["nodes"] = {{{"name", "far"}, {"translation", {outer.x, outer.y, outer.z}}, {"children", {1}}},
                        {{"name", "room"}, {"mesh", 0}, {"translation", {inner.x, inner.y, inner.z}}}};
  file.json["scenes"] = {{{"nodes", {0}}}};
  return file.gltf();
}

inline ImportedMesh import(const std::string& name, std::string_view bytes, const MeshImportOptions& options = {}) {
  const TempFolder folder;
  return import_mesh(folder.write(name, bytes), options);
}

/// A mesh of one material as a scene, without a file between.
inline std::shared_ptr<const Scene> scene_of(TriangleMesh mesh, float absorption = 0.2f, float scattering = 0.5f) {
  if (mesh.material_names.empty()) mesh.material_names = {"wall"};
  if (mesh.object_names.empty()) mesh.object_names = {"room"};
  mesh.triangle_material.resize(mesh.triangles.size(), 0);
  mesh.triangle_object.resize(mesh.triangles.size(), 0);
  std::vector<Material> materials(mesh.material_names.size(), Material::uniform("wall", absorption, scattering));
  Air air;
  air.speed_of_sound_m_per_s = 343.f;
  return std::make_shared<const Scene>("test", std::move(mesh), std::move(materials), air);
}

inline std::shared_ptr<const Scene> scene_of(const DoubleMesh& mesh, float absorption = 0.2f, float scattering = 0.5f) {
  TriangleMesh floats;
  for (const glm::dvec3 v : mesh.vertices) floats.vertices.emplace_back(v);
  floats.triangles = mesh.triangles;
  return scene_of(std::move(floats), absorption, scattering);
}

/// Points and directions that do not favour an axis.
inline glm::vec3 random_direction(std::uint32_t index, std::uint32_t stream = 0) {
  const auto u = RandomStream(91, Purpose::test, index, stream).uniform2(0);
  const float y = 1 - 2 * u[0], radius = std::sqrt(std::max(0.f, 1 - y * y)), angle = 6.2831853f * u[1];
  return {radius * std::cos(angle), y, radius * std::sin(angle)};
}

}  // namespace earshot::mesh_cases
