// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/annotated_import.h"

#include <fmt/format.h>

#include <glm/geometric.hpp>
#include <optional>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/annotations/annotated_surfaces.h"
#include "sim/scene/annotations/annotation_files.h"
#include "sim/scene/annotations/name_transfer.h"
#include "sim/scene/readers/named_import.h"

namespace earshot {
namespace {

namespace fs = std::filesystem;

double area_m2(const TriangleMesh& mesh, std::size_t triangle) {
  const glm::uvec3 corners = mesh.triangles[triangle];
  const glm::dvec3 a = mesh.vertices[corners.x], b = mesh.vertices[corners.y], c = mesh.vertices[corners.z];
  return 0.5 * glm::length(glm::cross(b - a, c - a));
}

void report_unlabelled(const fs::path& names, ImportedMesh& imported) {
  const TriangleMesh& mesh = imported.mesh;
  double all_m2 = 0, unlabelled_m2 = 0;
  std::size_t count = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    all_m2 += area_m2(mesh, t);
    if (!is_no_category(mesh.material_names[mesh.triangle_material[t]])) continue;
    unlabelled_m2 += area_m2(mesh, t);
    ++count;
  }
  if (count == 0) return;
  imported.report.warnings.push_back(fmt::format("{:.1f} % of the area ({} of {} triangles) has no category in {}",
                                                 all_m2 > 0 ? 100 * unlabelled_m2 / all_m2 : 0, count, mesh.triangles.size(),
                                                 names.filename().string()));
}

bool is_ply(const fs::path& mesh) { return fold_case(mesh.extension().string()) == ".ply"; }

/// Reads a mesh whose surfaces carry numbers or colours.
NamedMesh import_carrier(const AnnotationFiles& files, const MeshImportOptions& options, bool& is_used) {
  AnnotatedSurfaces surfaces(files);
  NamedMesh named = import_named_mesh(files.carrier, options, &surfaces);
  is_used = surfaces.is_used();
  return named;
}

ImportedMesh import_with_transfer(const fs::path& mesh, const AnnotationFiles& files, const MeshImportOptions& options) {
  ImportedMesh imported = import_mesh(mesh, options);
  bool is_used = false;
  const NamedMesh carrier = import_carrier(files, options, is_used);
  if (!is_used)
    throw InputError(files.carrier.string(),
                     fmt::format("has no numbers or colors on its surfaces for {}", files.names.filename().string()),
                     "copy the data set again");
  transfer_names(carrier.imported.mesh, imported.mesh);
  return imported;
}

/// Whether the surfaces of a mesh may carry numbers or colours themselves: faces of a PLY with numbers, a glTF called X.semantic.
bool may_carry(const fs::path& mesh, const fs::path& carrier) {
  const std::string extension = fold_case(mesh.extension().string());
  std::error_code error;
  return is_ply(mesh) ||
         ((extension == ".glb" || extension == ".gltf") && (mesh.stem().string().ends_with(".semantic") || !fs::exists(carrier, error)));
}

ImportedMesh import_with_named(const fs::path& mesh, const MeshImportOptions& options, const fs::path& names) {
  static_cast<void>(read_annotations(names));  // before the mesh: it may be missing or damaged
  const AnnotationFiles other{names, carrier_beside(names)};
  bool is_used = false;
  if (may_carry(mesh, other.carrier)) {
    NamedMesh named = import_carrier({names, mesh}, options, is_used);
    if (is_used) return std::move(named.imported);
  }
  std::error_code error;
  if (!fs::exists(other.carrier, error) || fs::equivalent(mesh, other.carrier, error))
    throw InputError(mesh.string(), fmt::format("carries no numbers for {}, and {} is not there", names.string(), other.carrier.string()),
                     "give the annotated mesh of the data set, or leave out `annotations`");
  return import_with_transfer(mesh, other, options);
}

/// With the first of the pairs that has names for the surfaces; nullopt where the mesh itself should carry numbers or colours and has none.
std::optional<ImportedMesh> import_with_present(const fs::path& mesh, const std::vector<AnnotationFiles>& present,
                                                const MeshImportOptions& options) {
  bool may_carry_itself = true;
  for (const AnnotationFiles& files : present) {
    std::optional<ImportedMesh> imported;
    if (files.carrier != mesh) {
      imported = import_with_transfer(mesh, files, options);
    } else if (may_carry_itself) {
      NamedMesh named = import_carrier(files, options, may_carry_itself);
      if (may_carry_itself) imported = std::move(named.imported);
    }
    if (!imported) continue;
    report_unlabelled(files.names, *imported);
    return imported;
  }
  return std::nullopt;
}

}  // namespace

ImportedMesh import_annotated_mesh(const fs::path& mesh, const MeshImportOptions& options, const AnnotationFiles& files) {
  static_cast<void>(read_annotations(files.names));  // before the mesh: it may be missing or damaged
  if (std::optional<ImportedMesh> imported = import_with_present(mesh, {files}, options)) return std::move(*imported);
  return import_annotated_mesh(mesh, options, std::nullopt);
}

ImportedMesh import_annotated_mesh(const fs::path& mesh, const MeshImportOptions& options, const std::optional<fs::path>& annotations) {
  if (annotations) {
    ImportedMesh imported = import_with_named(mesh, options, *annotations);
    report_unlabelled(*annotations, imported);
    return imported;
  }
  const std::vector<AnnotationFiles> present = present_annotations(mesh);
  if (std::optional<ImportedMesh> imported = import_with_present(mesh, present, options)) return std::move(*imported);
  NamedMesh named = import_named_mesh(mesh, options, nullptr);
  std::vector<std::string>& warnings = named.imported.report.warnings;
  if (!present.empty())
    warnings.push_back(fmt::format("{} beside the mesh is not read: its {}", present.front().names.string(),
                                   is_ply(mesh) ? "faces carry no ids" : "surfaces carry no colors"));
  for (std::string& line : unread_annotations(mesh)) warnings.push_back(std::move(line));
  if (named.has_face_ids)
    warnings.emplace_back(
        "faces carry object ids, but no info_semantic.json, .house or `annotations` of the scene YAML names them: 100 % of the area has no "
        "category");
  return std::move(named.imported);
}

}  // namespace earshot
