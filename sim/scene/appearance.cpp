// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/appearance.h"

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>

#include "sim/base/errors.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/acoustic_randomization.h"
#include "sim/scene/color.h"
#include "sim/scene/habitat/habitat_looks.h"
#include "sim/scene/habitat/habitat_scene.h"
#include "sim/scene/materials/semantic_materials.h"
#include "sim/scene/mesh_spec.h"
#include "sim/scene/point_cloud/cloud_import.h"
#include "sim/scene/scene_config.h"
#include "sim/scene/surface_palette.h"

namespace earshot {
namespace {

/// Answers per (slot, object), of which a mesh has few.
template <class Value, class Make>
std::vector<Value> per_triangle(const TriangleMesh& mesh, Make make) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, Value> known;
  std::vector<Value> values(mesh.triangles.size());
  for (std::size_t t = 0; t < values.size(); ++t) {
    const std::pair<std::uint32_t, std::uint32_t> key{mesh.triangle_material[t], mesh.triangle_object[t]};
    auto found = known.find(key);
    if (found == known.end()) found = known.emplace(key, make(key.first, key.second)).first;
    values[t] = found->second;
  }
  return values;
}

/// The words of a name without what tells copies apart (numbers and single letters at the end): "NightStandA_01_002" is {night, stand}.
std::vector<std::string> words_without_index(std::string_view name) {
  std::vector<std::string> words;
  const auto kind = [](char c) { return c >= '0' && c <= '9' ? 0 : c >= 'A' && c <= 'Z' ? 1 : c >= 'a' && c <= 'z' ? 2 : 3; };
  for (std::size_t i = 0; i < name.size(); ++i) {
    if (kind(name[i]) == 3) continue;
    const int before = i == 0 ? 3 : kind(name[i - 1]), now = kind(name[i]);
    const bool begins = before == 3 || (before == 0) != (now == 0) || (before == 2 && now == 1);
    if (begins || words.empty()) words.emplace_back();
    words.back() += fold_case(name.substr(i, 1));
  }
  while (!words.empty() && (words.back().size() == 1 || kind(words.back().front()) == 0)) words.pop_back();
  return words;
}

/// As SemanticMaterials::category_of; then the same of the words without an index, joined by underscores or by nothing.  Whole names only:
/// a floor lamp is not a floor.
std::string category_of(const SemanticMaterials& semantics, std::string_view name) {
  std::string category = semantics.category_of(name);
  for (std::size_t begin = 0; category.empty() && begin <= name.size();) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    const std::vector<std::string> words = words_without_index(name.substr(begin, end - begin));
    for (const char* between : {"_", ""})
      if (category.empty()) category = semantics.category_of(listed(words, between));
    begin = end + 1;
  }
  return category;
}

std::vector<std::uint16_t> categories_of(const Scene& scene) {
  const SemanticMaterials semantics = SemanticMaterials::indoor();
  const std::vector<std::string>& names = category_names();
  const auto number_of = [&](const std::string& category) -> std::uint16_t {
    const auto found = std::lower_bound(names.begin() + 1, names.end(), category);
    return found != names.end() && *found == category ? static_cast<std::uint16_t>(found - names.begin()) : std::uint16_t{0};
  };
  const TriangleMesh& mesh = scene.mesh();
  return per_triangle<std::uint16_t>(mesh, [&](std::uint32_t slot, std::uint32_t object) {
    std::uint16_t number = number_of(category_of(semantics, mesh.object_names[object]));
    if (number == 0) number = number_of(category_of(semantics, mesh.material_names[slot]));
    if (number == 0) number = number_of(scene.materials()[slot].category);
    return number;
  });
}

/// The file's own colour of a slot.  Slots that node names split are called "slot (material)".
const glm::vec3* color_in_file(const std::map<std::string, glm::vec3>& colors, const std::string& slot) {
  auto found = colors.find(slot);
  if (found == colors.end() && slot.ends_with(')')) found = colors.find(slot.substr(0, slot.rfind(" (")));
  return found == colors.end() ? nullptr : &found->second;
}

std::vector<glm::vec3> colors_of(const Scene& scene, const VisualMesh& file) {
  const TriangleMesh& mesh = scene.mesh();
  return per_triangle<glm::vec3>(mesh, [&](std::uint32_t slot, std::uint32_t object) {
    const std::string& name = mesh.material_names[slot];
    const glm::vec3* color = color_in_file(file.color_of_material, name);
    if (!color) color = color_in_file(file.color_of_material, std::string(without_object(name, mesh.object_names[object])));
    if (color) return *color;
    if (file.varies) return glm::vec3(1);
    const glm::vec3 encoded = palette_color(scene.materials()[slot].name, mesh.object_names[object]);
    return glm::vec3(decode_srgb(encoded.x), decode_srgb(encoded.y), decode_srgb(encoded.z));
  });
}

/// The lid that a scene YAML adds is in no file.
void append_lid(const Scene& scene, const std::vector<glm::vec3>& triangle_color, VisualMesh& mesh) {
  const TriangleMesh& all = scene.mesh();
  for (std::size_t t = 0; t < all.triangles.size(); ++t) {
    if (all.object_names[all.triangle_object[t]] != "ceiling_lid") continue;
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    for (int corner = 0; corner < 3; ++corner) mesh.vertices.push_back(all.vertices[all.triangles[t][corner]]);
    mesh.triangles.emplace_back(first, first + 1, first + 2);
    mesh.triangle_paint.push_back(static_cast<std::uint32_t>(mesh.paints.size()));
    mesh.paints.push_back({.base_color = triangle_color[t]});
  }
  mesh.uvs.resize(mesh.vertices.size(), glm::vec2(0));
  mesh.colors.resize(mesh.vertices.size(), glm::vec3(1));
}

}  // namespace

const std::vector<std::string>& category_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all{"unknown"};
    const SemanticMaterials semantics = SemanticMaterials::indoor();
    for (const auto& [category, materials] : semantics.all())
      if (category != "unknown") all.push_back(category);  // a sorted map
    all.emplace_back("agent");
    return all;
  }();
  return names;
}

std::shared_ptr<const Appearance> load_appearance(const Scene& scene, const SceneOverrides& overrides, const AppearanceOptions& options) {
  auto appearance = std::make_shared<Appearance>();
  appearance->triangle_category = categories_of(scene);

  SceneConfig config;
  const MeshSpec named = parse_mesh_spec(scene.name());
  config.mesh = named.path;
  if (named.unit_m) config.import.unit_m = *named.unit_m;
  if (named.up) config.import.up = *named.up;
  const std::string extension = fold_case(std::filesystem::path(scene.name()).extension().string());
  if (!is_habitat_scene(scene.name()) && (extension == ".yaml" || extension == ".yml")) config = read_scene_config(scene.name());
  if (overrides.unit_m) config.import.unit_m = *overrides.unit_m;
  if (overrides.up) config.import.up = *overrides.up;
  VisualMesh file;
  const bool generated = config.mesh.starts_with("shoebox:") || config.mesh.starts_with("house:") || config.mesh.starts_with("floor:");
  if (!generated && is_habitat_scene(config.mesh))
    file = read_habitat_looks(config.mesh, scene.origin_m(), options.largest_texture_px);
  else if (!generated && is_mesh_file(config.mesh) && !is_point_cloud(config.mesh))
    file = read_visual_mesh(config.mesh, config.import, scene.origin_m(), options.largest_texture_px);
  appearance->warnings = file.warnings;
  appearance->triangle_color = colors_of(scene, file);
  if (file.varies && options.detail) {
    if (config.ceiling_m) append_lid(scene, appearance->triangle_color, file);
    EmbreeScene rays(file.vertices, file.triangles);
    appearance->detail.emplace(Appearance::Detail{std::move(file), std::move(rays)});
  }
  return appearance;
}

}  // namespace earshot
