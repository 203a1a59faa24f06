// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/point_cloud/cloud_import.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec4.hpp>
#include <limits>
#include <string>

#include "sim/base/coordinates.h"
#include "sim/base/errors.h"
#include "sim/scene/mesh/mesh_repair.h"
#include "sim/scene/mesh/mesh_simplify.h"
#include "sim/scene/point_cloud/cloud_air.h"
#include "sim/scene/point_cloud/cloud_surface.h"
#include "sim/scene/point_cloud/point_voxels.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/text_scanner.h"

namespace earshot {
namespace {

constexpr double kCellPerSpacing = 5;  // of the default cell
constexpr double kMinDefaultCellM = 0.02;
// Of a cell: what the surface may move by where triangles are taken out of flat parts, and what it does by the quadric error.
constexpr double kMaxShiftCells = 0.5, kMaxQuadricErrorCells = 0.2;
constexpr float kCosine45 = 0.70710678f;
constexpr double kMinReportedHoleFraction = 0.01;  // of the surface in closed openings

void move_to_world(std::vector<glm::dvec3>& positions, const MeshImportOptions& options, const std::string& where) {
  const glm::dmat4 to_world = file_to_world(options);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    positions[i] = to_world * glm::dvec4(positions[i], 1.0);
    if (!is_valid_position(positions[i]))
      throw InputError(where, fmt::format("point {} is farther than {:g} m from the origin", i, kMaxCoordinateM),
                       "remove it, or check the unit");
  }
}

void choose_cell(std::span<const glm::dvec3> positions, const MeshImportOptions& options, ImportReport& report) {
  CloudReport& cloud = *report.cloud;
  cloud.is_cell_given = options.cell_m.has_value();
  if (options.cell_m) {
    cloud.cell_m = *options.cell_m;
    return;
  }
  cloud.spacing_m = median_spacing_m(positions);
  // Two digits: the number can be given back.
  const double default_cell_m = std::clamp(kCellPerSpacing * cloud.spacing_m, kMinDefaultCellM, kMaxCellM);
  cloud.cell_m = parse_decimal(fmt::format("{:.2g}", default_cell_m)).value();
  report.warnings.push_back(fmt::format(
      "no cell is given for the point cloud: {:g} m is used, from a median spacing of {:.2g} m (--cell, or cell_m in a scene YAML)",
      cloud.cell_m, cloud.spacing_m));
}

double area_of(const TriangleMesh& mesh, glm::uvec3 t) {
  const glm::dvec3 a(mesh.vertices[t.x]), b(mesh.vertices[t.y]), c(mesh.vertices[t.z]);
  return 0.5 * glm::length(glm::cross(b - a, c - a));
}

/// Normals point towards the air.
double enclosed_m3(const TriangleMesh& mesh) {
  double volume = 0;
  const glm::dvec3 origin = mesh.vertices.empty() ? glm::dvec3(0) : glm::dvec3(mesh.vertices.front());
  for (const glm::uvec3 t : mesh.triangles) {
    const glm::dvec3 a = glm::dvec3(mesh.vertices[t.x]) - origin, b = glm::dvec3(mesh.vertices[t.y]) - origin,
                     c = glm::dvec3(mesh.vertices[t.z]) - origin;
    volume -= glm::dot(a, glm::cross(b, c)) / 6;
  }
  return volume;
}

TriangleMesh mesh_of(const CloudSurface& surface, glm::dvec3 grid_m, const std::string& object) {
  TriangleMesh mesh;
  glm::dvec3 lower(std::numeric_limits<double>::infinity()), upper(-std::numeric_limits<double>::infinity());
  for (const glm::dvec3& vertex : surface.vertices) {
    lower = glm::min(lower, grid_m + vertex);
    upper = glm::max(upper, grid_m + vertex);
  }
  mesh.origin_m = origin_near(lower, upper);
  for (const glm::dvec3& vertex : surface.vertices) mesh.vertices.emplace_back(grid_m + vertex - mesh.origin_m);
  mesh.triangles = surface.triangles;
  mesh.triangle_object.assign(mesh.triangles.size(), intern(mesh.object_names, object));
  mesh.material_names = {"facing_up", "facing_down", "upright", "closed_hole"};
  for (const bool is_hole : surface.is_hole) mesh.triangle_material.push_back(is_hole ? 3 : 0);
  return mesh;
}

/// Takes out triangles with an edge of their own, and those that then have one.  Simplification folds narrow parts into pairs of triangles
/// on the same corners, of which the repair keeps one: a flap that bounds no air.  A mesh that this does not close stays as it is.
void remove_flaps(TriangleMesh& mesh) {
  constexpr int kMaxPasses = 16;
  TriangleMesh closed = mesh;
  std::vector<std::uint64_t> edges, open;
  const auto edge_of = [&](glm::uvec3 t, int corner) {
    const auto [low, high] = std::minmax(t[corner], t[(corner + 1) % 3]);
    return std::uint64_t{low} << 32 | high;
  };
  for (int pass = 0; pass < kMaxPasses; ++pass) {
    edges.clear();
    open.clear();
    for (const glm::uvec3 t : closed.triangles)
      for (int corner = 0; corner < 3; ++corner) edges.push_back(edge_of(t, corner));
    std::sort(edges.begin(), edges.end());
    for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
      while (end < edges.size() && edges[end] == edges[begin]) ++end;
      if (end - begin == 1) open.push_back(edges[begin]);
    }
    if (open.empty()) {
      mesh = std::move(closed);
      return;
    }
    std::size_t kept = 0;
    for (std::size_t i = 0; i < closed.triangles.size(); ++i) {
      bool is_flap = false;
      for (int corner = 0; corner < 3; ++corner)
        is_flap = is_flap || std::binary_search(open.begin(), open.end(), edge_of(closed.triangles[i], corner));
      if (is_flap) continue;
      closed.triangles[kept] = closed.triangles[i];
      closed.triangle_material[kept] = closed.triangle_material[i];
      closed.triangle_object[kept++] = closed.triangle_object[i];
    }
    closed.triangles.resize(kept);
    closed.triangle_material.resize(kept);
    closed.triangle_object.resize(kept);
  }
}

/// Names the parts that points were seen of by where they face, and drops names that nothing has.
void name_by_facing(TriangleMesh& mesh) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    std::uint32_t& slot = mesh.triangle_material[i];
    if (slot == 0) {
      const glm::uvec3 t = mesh.triangles[i];
      const glm::vec3 a = mesh.vertices[t.x], across = glm::cross(mesh.vertices[t.y] - a, mesh.vertices[t.z] - a);
      const float height = across.y / std::max(glm::length(across), std::numeric_limits<float>::min());
      slot = height >= kCosine45 ? 0 : height <= -kCosine45 ? 1 : 2;
    }
    slot = intern(names, mesh.material_names[slot]);
  }
  mesh.material_names = std::move(names);
}

void describe_holes(const TriangleMesh& mesh, ImportReport& report) {
  CloudReport& cloud = *report.cloud;
  double area_m2 = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const double area = area_of(mesh, mesh.triangles[i]);
    area_m2 += area;
    if (mesh.material_names[mesh.triangle_material[i]] == "closed_hole") cloud.hole_area_m2 += area;
  }
  cloud.air_m3 = enclosed_m3(mesh);
  if (cloud.hole_area_m2 > kMinReportedHoleFraction * area_m2)
    report.warnings.push_back(fmt::format("the points leave {} holes open, which are closed: {:.1f} m2, {:.1f} % of the surface",
                                          cloud.holes, cloud.hole_area_m2, 100 * cloud.hole_area_m2 / area_m2));
}

}  // namespace

ImportedMesh import_point_cloud(const std::filesystem::path& path, const MeshImportOptions& options) {
  EARSHOT_EXPECT(options.unit_m > 0);
  const std::string where = path.string();
  PointCloud file = read_point_file(path);
  ImportedMesh imported;
  ImportReport& report = imported.report;
  CloudReport& cloud = report.cloud.emplace();
  report.warnings = std::move(file.warnings);
  cloud.points = file.positions.size() + file.num_invalid;
  cloud.invalid_points = file.num_invalid;
  move_to_world(file.positions, options, where);
  choose_cell(file.positions, options, report);

  PointVoxels voxels = sort_into_voxels(file.positions, cloud.cell_m, air_margin(cloud.cell_m), where);
  file.positions = {};
  cloud.stray_points = voxels.stray_points;
  VoxelField field(voxels.size, cloud.cell_m, where);
  const CloudAir air = find_cloud_air(voxels, field, where);
  cloud.closed_width_m = air.closed_width_m;
  cloud.holes = air.holes;
  cloud.unseen_m3 = static_cast<double>(air.unseen) * std::pow(cloud.cell_m, 3);

  imported.mesh = mesh_of(lay_surface(voxels, field), voxels.origin_m, one_line(path.stem().string()));
  const double moves_within_m = std::min(kMaxShiftCells * cloud.cell_m, 1.0);
  simplify_mesh(imported.mesh, static_cast<float>(moves_within_m),
                static_cast<float>(moves_within_m * kMaxQuadricErrorCells / kMaxShiftCells));
  remove_flaps(imported.mesh);
  report.triangles_read = imported.mesh.triangles.size();
  repair_mesh(imported.mesh, report);
  describe_holes(imported.mesh, report);
  name_by_facing(imported.mesh);
  return imported;
}

}  // namespace earshot
