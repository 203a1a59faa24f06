#include "apps/options/scene_options.h"

namespace earshot {

void SceneOptions::add_to(CLI::App& command) {
  command.add_option("SCENE", scene, "Mesh file, shoebox:XxYxZ[@M], house:SEED, floor:SEED, or scene YAML")->required();
  command.add_option("--unit", unit_m, "Metres per unit of a mesh file (0.01 for centimetres); default: what a YAML says, else 1");
  command.add_option("--up", up, "Axis that points up in a mesh file: y or z; default: what a YAML says, else y")
      ->check(CLI::IsMember({"y", "z"}));
}

void SceneOptions::add_simplify_to(CLI::App& command) {
  command.add_option("--simplify", simplify_m, "Simplify the mesh: largest deviation of its surface in metres, (0, 1]");
}

SceneOverrides SceneOptions::overrides() const {
  SceneOverrides overrides;
  overrides.unit_m = unit_m;
  if (simplify_m) overrides.simplify_m = static_cast<float>(*simplify_m);
  if (up) overrides.up = *up == "z" ? MeshImportOptions::Up::z : MeshImportOptions::Up::y;
  return overrides;
}

}  // namespace earshot
