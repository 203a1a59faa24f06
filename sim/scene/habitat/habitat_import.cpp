// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/habitat/habitat_import.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <utility>

#include "sim/base/errors.h"
#include "sim/scene/annotations/annotated_import.h"
#include "sim/scene/habitat/habitat_scene.h"
#include "sim/scene/mesh/mesh_repair.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/named_import.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

double area_of(const TriangleMesh& mesh, const glm::dmat4& to_world) {
  double area = 0;
  for (const glm::uvec3 corners : mesh.triangles) {
    const auto side = [&](std::uint32_t corner) { return glm::dvec3(mesh.vertices[corner]) - glm::dvec3(mesh.vertices[corners.x]); };
    area += 0.5 * glm::length(glm::cross(glm::dmat3(to_world) * side(corners.y), glm::dmat3(to_world) * side(corners.z)));
  }
  return area;
}

class SceneAssembler {
 public:
  explicit SceneAssembler(std::string where) : builder_(std::move(where), imported_.mesh) {}

  /// Takes the warnings of a mesh file, but for those of its size: it is a part of the scene.
  void take_warnings(const fs::path& mesh, const ImportedMesh& part) {
    ImportReport of_size;
    warn_about_size(part.mesh, 0, of_size);
    for (const std::string& warning : part.report.warnings)
      if (std::find(of_size.warnings.begin(), of_size.warnings.end(), warning) == of_size.warnings.end())
        imported_.report.warnings.push_back(fmt::format("{}: {}", mesh.filename().string(), warning));
  }

  /// name: gives each pair of material and object of the part its names.
  template <class Name>
  void append(const ImportedMesh& part, const glm::dmat4& to_world, Name name) {
    const TriangleMesh& mesh = part.mesh;
    std::vector<glm::dvec3> positions;
    positions.reserve(mesh.vertices.size());
    for (const glm::vec3 vertex : mesh.vertices) positions.push_back(glm::dvec3(vertex) + mesh.origin_m);
    std::vector<std::uint32_t> corners, numbers;
    std::vector<SurfaceName> names;
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> number_of;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      for (int corner = 0; corner < 3; ++corner) corners.push_back(mesh.triangles[t][corner]);
      const std::pair<std::uint32_t, std::uint32_t> key{mesh.triangle_material[t], mesh.triangle_object[t]};
      const auto [found, is_new] = number_of.try_emplace(key, static_cast<std::uint32_t>(names.size()));
      if (is_new) names.push_back(name(mesh.material_names[key.first], mesh.object_names[key.second]));
      numbers.push_back(found->second);
    }
    builder_.append("", "", to_world, positions, corners, PositionDigits::doubles);
    builder_.name_last(numbers, names);
    ImportReport& all = imported_.report;
    all.triangles_read += part.report.triangles_read;
    all.degenerate_removed += part.report.degenerate_removed;
    all.duplicate_removed += part.report.duplicate_removed;
    all.vertices_welded += part.report.vertices_welded;
  }

  ImportedMesh finish(std::vector<std::string> warnings) {
    builder_.finish();
    repair_mesh(imported_.mesh, imported_.report);
    warn_about_size(imported_.mesh, builder_.position_step_m(), imported_.report);
    std::vector<std::string>& all = imported_.report.warnings;
    all.insert(all.end(), std::make_move_iterator(warnings.begin()), std::make_move_iterator(warnings.end()));
    return std::move(imported_);
  }

 private:
  ImportedMesh imported_;
  MeshBuilder builder_;
};

ImportedMesh import_stage(const HabitatScene& scene) {
  const fs::path& mesh = scene.stage.mesh;
  if (!scene.descriptor) return import_annotated_mesh(mesh, {}, std::nullopt);
  return import_annotated_mesh(mesh, {}, AnnotationFiles{*scene.descriptor, scene.semantic_mesh.value_or(mesh)});
}

/// Objects with the classes of the descriptor.  Returns the line for those without a class; empty for none.
std::string append_objects(const HabitatScene& scene, SceneAssembler& assembler) {
  const std::map<std::int64_t, std::string> classes =
      scene.descriptor ? read_classes(*scene.descriptor) : std::map<std::int64_t, std::string>{};
  std::map<fs::path, ImportedMesh> parts;
  double all_m2 = 0, without_m2 = 0;
  std::size_t num_without = 0;
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    const PlacedAsset& object = scene.objects[i];
    const auto [part, is_new] = parts.try_emplace(object.mesh);
    if (is_new) {
      part->second = import_mesh(object.mesh);
      assembler.take_warnings(object.mesh, part->second);
    }
    const auto found = object.semantic_id ? classes.find(*object.semantic_id) : classes.end();
    const std::string category = found != classes.end() && !found->second.empty() && !is_no_category(found->second) ? found->second : "";
    const glm::dmat4 to_world = matrix_of(object.placement, part->second.mesh);
    const double area_m2 = area_of(part->second.mesh, to_world);
    all_m2 += area_m2;
    if (category.empty()) without_m2 += area_m2, ++num_without;
    const std::string node = category.empty() ? object.name : fmt::format("{}_{}", category, i);
    assembler.append(part->second, to_world, [&](const std::string& material, const std::string&) {
      return SurfaceName{category.empty() ? material : category, node};
    });
  }
  if (classes.empty() || num_without == 0) return {};
  return fmt::format("{:.1f} % of the area of the objects ({} of {} objects) has no category in {}",
                     all_m2 > 0 ? 100 * without_m2 / all_m2 : 0, num_without, scene.objects.size(), scene.descriptor->filename().string());
}

}  // namespace

ImportedMesh import_habitat_scene(const std::string& spec) {
  HabitatScene scene = read_habitat_scene(spec);
  SceneAssembler assembler(spec);
  const ImportedMesh stage = import_stage(scene);
  assembler.take_warnings(scene.stage.mesh, stage);
  assembler.append(stage, matrix_of(scene.stage.placement, stage.mesh), [](const std::string& material, const std::string& object) {
    return SurfaceName{material, object};
  });
  std::string line = append_objects(scene, assembler);
  if (!line.empty()) scene.warnings.push_back(std::move(line));
  return assembler.finish(std::move(scene.warnings));
}

}  // namespace earshot
