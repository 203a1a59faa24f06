// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/readers/gltf_extensions.h"

#include <fmt/format.h>

#include <charconv>
#include <map>
#include <set>
#include <string_view>

#include "sim/base/errors.h"
#include "sim/scene/readers/mesh_builder.h"

namespace earshot {
namespace {

using Json = nlohmann::json;

/// Extensions that the reader applies, or that have no part in geometry.
bool is_known_extension(std::string_view name) {
  static const std::set<std::string_view> known{
      // Applied.
      "EXT_mesh_gpu_instancing", "KHR_mesh_quantization", "KHR_texture_transform",
      // Looks.
      "KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_materials_diffuse_transmission", "KHR_materials_dispersion",
      "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_iridescence", "KHR_materials_pbrSpecularGlossiness",
      "KHR_materials_sheen", "KHR_materials_specular", "KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_variants",
      "KHR_materials_volume", "KHR_texture_basisu", "KHR_texture_ktx", "EXT_texture_avif", "EXT_texture_webp", "MSFT_texture_dds",
      "CESIUM_primitive_outline", "MOZ_lightmap", "NV_materials_mdl",
      // Lights and sounds.
      "KHR_lights_punctual", "EXT_lights_ies", "EXT_lights_image_based", "KHR_audio_emitter", "MSFT_audio_emitter",
      // Descriptions, behaviour, levels of detail (the finest one is the node itself).
      "KHR_animation_pointer", "KHR_implicit_shapes", "KHR_interactivity", "KHR_node_hoverability", "KHR_node_selectability",
      "KHR_physics_rigid_bodies", "KHR_xmp", "KHR_xmp_json_ld", "AGI_articulations", "AGI_stk_metadata", "EXT_feature_metadata",
      "EXT_instance_features", "EXT_mesh_features", "EXT_mesh_manifold", "EXT_structural_metadata", "FB_geometry_metadata",
      "GODOT_single_root", "MOZ_hubs_components", "MSFT_lod", "OMI_collider", "OMI_physics_body", "OMI_physics_shape", "VRM",
      "VRMC_node_constraint", "VRMC_springBone", "VRMC_vrm"};
  return known.contains(name);
}

/// Compression, beside which the uncompressed data lie unless the extension is required.
bool has_fallback(std::string_view name) {
  return name == "KHR_draco_mesh_compression" || name == "EXT_meshopt_compression" || name == "KHR_meshopt_compression";
}

/// Whether a version "major.minor" is above 2.0; true for text that is not a version.
bool is_above_2_0(std::string_view version) {
  unsigned major = 0, minor = 0;
  const char* end = version.data() + version.size();
  const auto first = std::from_chars(version.data(), end, major);
  if (first.ec != std::errc() || first.ptr == end || *first.ptr != '.') return true;
  const auto second = std::from_chars(first.ptr + 1, end, minor);
  return second.ec != std::errc() || second.ptr != end || major > 2 || (major == 2 && minor > 0);
}

/// Unknown extensions, each with the first place that has it.
class ExtensionSearch {
 public:
  void look_at(const Json& object, const std::string& place) {
    if (!object.is_object() || !object.contains("extensions") || !object["extensions"].is_object()) return;
    for (const auto& [name, value] : object["extensions"].items())
      if (!is_known_extension(name) && !has_fallback(name)) places_.try_emplace(name, place);
  }
  void look_at_list(const Json& file, const char* key) {
    if (!file.contains(key) || !file[key].is_array()) return;
    for (std::size_t i = 0; i < file[key].size(); ++i) look_at(file[key][i], fmt::format("{}[{}]", key, i));
  }
  void look_at_primitives(const Json& file) {
    if (!file.contains("meshes") || !file["meshes"].is_array()) return;
    for (std::size_t i = 0; i < file["meshes"].size(); ++i) {
      const Json& mesh = file["meshes"][i];
      if (!mesh.is_object() || !mesh.contains("primitives") || !mesh["primitives"].is_array()) continue;
      for (std::size_t p = 0; p < mesh["primitives"].size(); ++p)
        look_at(mesh["primitives"][p], fmt::format("meshes[{}].primitives[{}]", i, p));
    }
  }
  [[nodiscard]] std::vector<std::string> warnings() const {
    std::vector<std::string> lines;
    for (const auto& [name, place] : places_)
      lines.push_back(fmt::format("the unknown glTF extension {} ({}) is ignored; it may change the geometry", one_line(name), place));
    return lines;
  }

 private:
  std::map<std::string, std::string> places_;
};

}  // namespace

std::vector<std::string> check_gltf_extensions(const Json& json, const std::string& where) {
  const Json& asset = json.at("asset");
  const std::string minimum = asset.value("minVersion", std::string("2.0"));
  if (is_above_2_0(minimum))
    throw InputError(where, fmt::format("needs glTF {} (asset.minVersion)", one_line(minimum)), "export it as glTF 2.0");
  if (json.contains("extensionsRequired")) {
    for (const Json& extension : json["extensionsRequired"]) {
      const auto name = extension.get<std::string>();
      if (is_known_extension(name)) continue;
      throw InputError(where, fmt::format("needs the extension {}, which is not supported", one_line(name)),
                       has_fallback(name) ? "export the file without compression" : "export the file without it");
    }
  }
  ExtensionSearch search;
  search.look_at(json, "the file");
  for (const char* key : {"scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers"}) search.look_at_list(json, key);
  search.look_at_primitives(json);
  return search.warnings();
}

}  // namespace earshot
