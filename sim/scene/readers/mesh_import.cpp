// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/mesh_import.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/mesh/mesh_repair.h"
#include "sim/scene/readers/gltf_reader.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/mesh_file.h"
#include "sim/scene/readers/named_import.h"

namespace earshot {
namespace {

constexpr std::array<const char*, 5> extensions{".glb", ".gltf", ".obj", ".ply", ".stl"};
constexpr std::array<const char*, 6> cloud_extensions{".pcd", ".xyz", ".pts", ".asc", ".las", ".laz"};

std::string folded_extension(const std::filesystem::path& path) { return fold_case(path.extension().string()); }

/// Whether an edge belongs to one triangle only.
bool has_open_edge(const TriangleMesh& mesh) {
  std::vector<std::uint64_t> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const glm::uvec3 t : mesh.triangles) {
    for (int c = 0; c < 3; ++c) {
      const auto [low, high] = std::minmax(t[c], t[(c + 1) % 3]);
      edges.push_back(std::uint64_t{low} << 32 | high);
    }
  }
  std::sort(edges.begin(), edges.end());
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const bool same_before = i > 0 && edges[i - 1] == edges[i], same_behind = i + 1 < edges.size() && edges[i + 1] == edges[i];
    if (!same_before && !same_behind) return true;
  }
  return false;
}

/// OBJ, PLY and STL.  Returns the doubts of the reader.
std::vector<std::string> read_file_parts(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder,
                                         SurfaceNames* names, NamedMesh& named) {
  MeshFile file = read_mesh_file(path);
  for (const MeshPart& part : file.parts) {
    builder.append(part.object, part.material, file_to_world, part.positions, part.corners,
                   part.has_floats ? PositionDigits::floats : PositionDigits::doubles);
    named.has_face_ids = named.has_face_ids || !part.triangle_ids.empty();
    if (!names || part.triangle_ids.empty()) continue;
    const std::vector<std::uint32_t> numbers = names->of_faces(part.triangle_ids);  // all() is for after it
    builder.name_last(numbers, names->all());
  }
  named.imported.report.warnings = std::move(file.warnings);
  return std::move(file.doubts);
}

}  // namespace

void warn_about_size(const TriangleMesh& mesh, double position_step_m, ImportReport& report) {
  const Bounds bounds = bounds_of(mesh);
  const glm::dvec3 size = glm::dvec3(bounds.upper) - glm::dvec3(bounds.lower);
  const double largest_m = std::max({size.x, size.y, size.z});
  if (largest_m > 500 || largest_m < 0.5) {
    report.warnings.push_back(fmt::format("the scene is {:.4g} m in size: is the unit right? (unit_m in a scene YAML)", largest_m));
  }
  if (position_step_m > 2e-6 * largest_m) {
    report.warnings.push_back(
        fmt::format("the mesh is so far from the origin that its coordinates are exact to {:.2g} m only, in a scene of {:.4g} m; move the "
                    "mesh to the origin of the file",
                    position_step_m, largest_m));
  }
}

bool is_mesh_file(const std::filesystem::path& path) {
  return std::find(extensions.begin(), extensions.end(), folded_extension(path)) != extensions.end() || has_cloud_extension(path);
}

bool has_cloud_extension(const std::filesystem::path& path) {
  return std::find(cloud_extensions.begin(), cloud_extensions.end(), folded_extension(path)) != cloud_extensions.end();
}

glm::dmat4 file_to_world(const MeshImportOptions& options) {
  const double unit = options.unit_m;
  return options.up == MeshImportOptions::Up::z ? glm::dmat4(unit, 0, 0, 0, 0, 0, -unit, 0, 0, unit, 0, 0, 0, 0, 0, 1)
                                                : glm::dmat4(unit, 0, 0, 0, 0, unit, 0, 0, 0, 0, unit, 0, 0, 0, 0, 1);
}

NamedMesh import_named_mesh(const std::filesystem::path& path, const MeshImportOptions& options, SurfaceNames* names) {
  EARSHOT_EXPECT(options.unit_m > 0);
  const std::string where = path.string();
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(where, "does not exist", "check the path of the mesh");
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(where, "is not a file", "give a glb, gltf, obj, ply or stl file");
  if (!is_mesh_file(path) || has_cloud_extension(path))
    throw InputError(where, "has an unknown extension", "give a glb, gltf, obj, ply or stl file");
  if (options.cell_m) throw InputError(where, "has faces and takes no cell", "leave out the cell: point clouds alone take one");

  NamedMesh named;
  ImportedMesh& imported = named.imported;
  const std::string extension = folded_extension(path);
  MeshBuilder builder(where, imported.mesh);
  std::vector<std::string> doubts;
  if (extension == ".glb" || extension == ".gltf")
    imported.report.warnings = read_gltf(path, file_to_world(options), builder, names);
  else
    doubts = read_file_parts(path, file_to_world(options), builder, names, named);
  builder.finish();
  imported.report.triangles_read = imported.mesh.triangles.size();
  if (imported.mesh.triangles.empty()) throw InputError(where, "has no triangles", "export the file with its surfaces");
  repair_mesh(imported.mesh, imported.report);
  if (imported.mesh.triangles.empty()) throw InputError(where, "has no triangle with an area", "export the file with its surfaces");
  if (!doubts.empty() && has_open_edge(imported.mesh))
    imported.report.warnings.insert(imported.report.warnings.end(), doubts.begin(), doubts.end());
  warn_about_size(imported.mesh, builder.position_step_m(), imported.report);
  return named;
}

ImportedMesh import_mesh(const std::filesystem::path& path, const MeshImportOptions& options) {
  return import_named_mesh(path, options, nullptr).imported;
}

}  // namespace earshot
