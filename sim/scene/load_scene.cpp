// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <optional>
#include <string>

#include "sim/base/errors.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/annotations/annotated_import.h"
#include "sim/scene/annotations/other_formats.h"
#include "sim/scene/generators/floor_plan.h"
#include "sim/scene/generators/house_generator.h"
#include "sim/scene/generators/shoebox.h"
#include "sim/scene/habitat/habitat_import.h"
#include "sim/scene/habitat/habitat_scene.h"
#include "sim/scene/materials/material_assignment.h"
#include "sim/scene/mesh/mesh_simplify.h"
#include "sim/scene/mesh_spec.h"
#include "sim/scene/point_cloud/cloud_import.h"
#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/scene.h"
#include "sim/scene/scene_config.h"

namespace earshot {
namespace {

/// A mesh and the materials that its slots came with (none for a mesh file).
struct Geometry {
  TriangleMesh mesh;
  std::vector<std::optional<Material>> slot_materials;
  ImportReport report;
};

Geometry make_geometry(const SceneConfig& config, const MaterialDatabase& database) {
  const std::string& spec = config.mesh;
  Geometry geometry;
  if (spec.starts_with("shoebox:")) {
    Shoebox box = parse_shoebox(std::string_view(spec).substr(8), database);
    geometry.mesh = std::move(box.mesh);
    geometry.slot_materials.assign(box.material_of_slot.begin(), box.material_of_slot.end());
  } else if (spec.starts_with("house:") || spec.starts_with("floor:")) {
    const std::string_view settings = std::string_view(spec).substr(6);
    geometry.mesh = spec.starts_with("house:") ? generate_house(parse_house(settings)) : generate_floor(parse_floor(settings));
    const MaterialDatabase builtin = MaterialDatabase::builtin();  // house materials are names of that one
    for (const std::string& name : geometry.mesh.material_names) geometry.slot_materials.emplace_back(builtin.get(name, spec));
  } else {
    ImportedMesh imported = is_habitat_scene(spec) ? import_habitat_scene(spec)
                            : is_point_cloud(spec) ? import_point_cloud(spec, config.import)
                                                   : import_annotated_mesh(spec, config.import, config.annotations);
    geometry.mesh = std::move(imported.mesh);
    geometry.report = std::move(imported.report);
  }
  if (geometry.report.triangles_read == 0) geometry.report.triangles_read = geometry.mesh.triangles.size();
  return geometry;
}

/// A horizontal lid over the bounding rectangle, facing down.
void add_ceiling(Geometry& geometry, double world_height_m, const std::string& where) {
  const Bounds bounds = bounds_of(geometry.mesh);
  TriangleMesh& mesh = geometry.mesh;
  const auto height_m = static_cast<float>(world_height_m - mesh.origin_m.y);
  if (!(height_m > bounds.lower.y)) {
    throw InputError(where,
                     fmt::format("ceiling_m = {} is not above the lowest point of the mesh, {} m", static_cast<float>(world_height_m),
                                 static_cast<float>(bounds.lower.y + mesh.origin_m.y)),
                     "it is a height in world coordinates, after up and unit_m");
  }
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (const float x : {bounds.lower.x, bounds.upper.x}) {
    for (const float z : {bounds.lower.z, bounds.upper.z}) mesh.vertices.emplace_back(x, height_m, z);
  }
  const std::uint32_t slot = intern(mesh.material_names, "ceiling_lid"), object = intern(mesh.object_names, "ceiling_lid");
  for (const glm::uvec3 corners : {glm::uvec3(0, 2, 3), glm::uvec3(0, 3, 1)}) {
    mesh.triangles.push_back(corners + glm::uvec3(first));
    mesh.triangle_material.push_back(slot);
    mesh.triangle_object.push_back(object);
  }
}

/// A handle of a scene of Habitat may end as a mesh file does.
bool takes_axes(const std::string& mesh) { return is_mesh_file(mesh) && !is_habitat_scene(mesh); }

/// What the SCENE text and the caller say of how a file is read goes over what a YAML says.
void apply_choices(const std::string& spec, const MeshSpec& named, const SceneOverrides& overrides, SceneConfig& config) {
  if ((named.unit_m && overrides.unit_m) || (named.up && overrides.up) || (named.cell_m && overrides.cell_m))
    throw InputError(spec, "already names a unit, an up axis or a cell, but another one was given", "give it once");
  const bool is_file = takes_axes(config.mesh);
  const char* what = is_habitat_scene(config.mesh) ? "is a scene of Habitat" : "is generated";
  if (overrides.unit_m) {
    if (!is_file) throw InputError(spec, fmt::format("{} in metres and takes no unit", what), "leave out the unit");
    require(*overrides.unit_m >= 1e-6 && *overrides.unit_m <= 1e6, "unit", *overrides.unit_m, "must be in [1e-6, 1e6] metres per unit");
  }
  if (overrides.up && !is_file) throw InputError(spec, fmt::format("{} with y up and takes no up axis", what), "leave out the up axis");
  if (overrides.cell_m) {
    if (!is_file) throw InputError(spec, fmt::format("{} and takes no cell", what), "leave out the cell");
    require(*overrides.cell_m >= kMinCellM && *overrides.cell_m <= kMaxCellM, "cell", *overrides.cell_m, "must be in [0.001, 10] m");
  }
  if (const auto unit_m = named.unit_m ? named.unit_m : overrides.unit_m) config.import.unit_m = *unit_m, config.is_unit_given = true;
  if (const auto up = named.up ? named.up : overrides.up) config.import.up = *up, config.is_up_given = true;
  if (const auto cell_m = named.cell_m ? named.cell_m : overrides.cell_m) config.import.cell_m = *cell_m;
  if (is_file && !config.is_up_given && is_las_file(config.mesh)) config.import.up = MeshImportOptions::Up::z;  // z is the height there
}

bool is_scene_yaml(const std::string& spec) {
  if (is_habitat_scene(spec)) return false;
  const std::string extension = fold_case(std::filesystem::path(spec).extension().string());
  return extension == ".yaml" || extension == ".yml";
}

}  // namespace

Scene load_scene(const std::string& spec, const SceneOverrides& overrides) {
  const bool yaml = is_scene_yaml(spec), is_whole = yaml || is_habitat_scene(spec) || spec.starts_with("shoebox:") ||
                                                    spec.starts_with("house:") || spec.starts_with("floor:");
  const MeshSpec named = is_whole ? MeshSpec{.path = spec} : parse_mesh_spec(spec);
  if (!is_whole && !is_mesh_file(named.path)) {
    refuse_other_formats(named.path);
    throw InputError(spec, "is not a scene",
                     "give a glb, gltf, obj, ply, stl, pcd, xyz, las, scene_instance.json or yaml file, or write shoebox:XxYxZ[@M], "
                     "house:SEED or floor:SEED");
  }
  SceneConfig config;
  if (yaml)
    config = read_scene_config(spec);
  else
    config.mesh = named.path;
  if (yaml && (config.is_up_given || config.is_unit_given || config.import.cell_m) && !takes_axes(config.mesh))
    throw InputError(spec, "up, unit_m and cell_m have no effect on a generated mesh or a scene of Habitat", "remove them");
  apply_choices(spec, named, overrides, config);
  if (overrides.simplify_m) config.simplify_m = overrides.simplify_m;

  std::vector<MaterialWarning> material_warnings;
  const MaterialDatabase database =
      config.materials
          ? MaterialDatabase::from_file(*config.materials, MaterialImport{.reading = config.coefficients, .warnings = &material_warnings})
          : MaterialDatabase::builtin();
  if (config.own_semantics) config.rules.semantics->require_materials(database);
  refuse_other_formats(config.mesh);
  if (config.annotations && (!takes_axes(config.mesh) || is_point_cloud(config.mesh)))
    throw InputError(spec, "annotations have no effect on a generated mesh, a point cloud or a scene of Habitat", "remove them");
  Geometry geometry = make_geometry(config, database);
  if (takes_axes(config.mesh))
    geometry.report.axes = FileAxes{.unit_m = config.import.unit_m,
                                    .up = config.import.up == MeshImportOptions::Up::z ? 'z' : 'y',
                                    .is_unit_given = config.is_unit_given,
                                    .is_up_given = config.is_up_given};
  for (const MaterialWarning& warning : material_warnings) {
    geometry.report.warnings.push_back(fmt::format("{}: {}: {}", config.materials->string(), warning.material, warning.text));
  }
  if (config.ceiling_m) add_ceiling(geometry, *config.ceiling_m, spec);
  if (config.simplify_m) geometry.report.simplified = simplify_mesh(geometry.mesh, *config.simplify_m);
  config.rules.own_first = config.mesh.starts_with("shoebox:") && config.mesh.find('@') != std::string::npos;
  geometry.report.has_semantics = config.rules.semantics != nullptr;
  std::vector<Material> materials = assign_materials(geometry.mesh, config.rules, database, geometry.slot_materials, spec,
                                                     geometry.report.warnings, &geometry.report.choices);
  if (config.randomization) {
    const SemanticMaterials semantics = config.rules.semantics ? *config.rules.semantics : SemanticMaterials::indoor();
    randomize_materials(spec, geometry.mesh, materials, geometry.report, false, semantics, database, *config.randomization);
  }
  return Scene(spec, std::move(geometry.mesh), std::move(materials), config.air, std::move(geometry.report));
}

}  // namespace earshot
