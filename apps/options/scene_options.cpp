// SPDX-License-Identifier: Apache-2.0
#include "apps/options/scene_options.h"

#include "sim/base/errors.h"
#include "sim/scene/mesh_spec.h"

namespace earshot {

void AxesOptions::add_to(CLI::App& command) {
  command.add_option("--unit", unit_m,
                     "Metres per unit of a mesh file, for example 0.01 for centimetres (default: value of the scene YAML, else 1)");
  command.add_option("--up", up, "Axis of a mesh file that points up: y or z (default: value of the scene YAML, else y)")
      ->check(CLI::IsMember({"y", "z"}));
  command.add_option(
      "--cell", cell_m,
      "Edge of the voxels of a point cloud in metres (default: value of the scene YAML, else from the spacing of the points)");
}

std::optional<MeshImportOptions::Up> AxesOptions::up_axis() const {
  if (!up) return std::nullopt;
  return *up == "z" ? MeshImportOptions::Up::z : MeshImportOptions::Up::y;
}

std::vector<std::string> AxesOptions::applied_to(std::vector<std::string> scenes) const {
  if (scenes.empty() && is_given())
    throw InputError(up ? "--up" : unit_m ? "--unit" : "--cell", "describes a mesh file, but no SCENE is given", "name one");
  for (std::string& scene : scenes) scene = add_mesh_choices(scene, {.unit_m = unit_m, .up = up_axis(), .cell_m = cell_m});
  return scenes;
}

void SceneOptions::add_to(CLI::App& command) {
  command
      .add_option("SCENE", scene,
                  "Mesh or point cloud file[,unit=METRES][,up=z][,cell=METRES], scene_instance.json, shoebox:XxYxZ[@M], house:SEED, "
                  "floor:SEED, or scene YAML (see 'earshot --help')")
      ->required();
  axes.add_to(command);
}

void SceneOptions::add_simplify_to(CLI::App& command) {
  command.add_option("--simplify", simplify_m, "Simplify the mesh; the value is the largest deviation of its surface in metres, (0, 1]");
}

SceneOverrides SceneOptions::overrides() const {
  SceneOverrides overrides;
  overrides.unit_m = axes.unit_m;
  if (simplify_m) overrides.simplify_m = static_cast<float>(*simplify_m);
  overrides.up = axes.up_axis();
  overrides.cell_m = axes.cell_m;
  return overrides;
}

}  // namespace earshot
