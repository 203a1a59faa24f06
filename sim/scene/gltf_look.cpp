// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/gltf_look.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace earshot {
namespace {

using Json = nlohmann::json;

void read_transform(const Json& transform, GltfLook& look) {
  const auto pair_of = [&](const char* key, double fallback) {
    const auto pair = transform.value(key, std::array<double, 2>{fallback, fallback});
    return glm::dvec2(pair[0], pair[1]);
  };
  look.offset = pair_of("offset", 0);
  look.scale = pair_of("scale", 1);
  look.rotation_rad = transform.value("rotation", 0.0);
  if (transform.contains("texCoord")) look.uv_name = fmt::format("TEXCOORD_{}", transform["texCoord"].get<std::uint64_t>());
}

}  // namespace

GltfLook read_gltf_look(const Json& file, const Json& primitive) {
  GltfLook look;
  if (!primitive.contains("material")) return look;
  const Json& material = file.at("materials").at(primitive["material"].get<std::size_t>());
  if (!material.contains("pbrMetallicRoughness")) return look;
  const Json& surface = material["pbrMetallicRoughness"];
  if (surface.contains("baseColorFactor")) {
    const auto factor = surface["baseColorFactor"].get<std::array<double, 4>>();
    look.base_color = glm::vec3(bounded_number(factor[0], 0, 1), bounded_number(factor[1], 0, 1), bounded_number(factor[2], 0, 1));
  }
  if (!surface.contains("baseColorTexture")) return look;
  const Json& use = surface["baseColorTexture"];
  look.uv_name = fmt::format("TEXCOORD_{}", use.value("texCoord", std::uint64_t{0}));
  if (use.contains("extensions") && use["extensions"].contains("KHR_texture_transform"))
    read_transform(use["extensions"]["KHR_texture_transform"], look);
  const Json& texture = file.at("textures").at(use.at("index").get<std::size_t>());
  if (texture.contains("source")) look.image = texture["source"].get<std::size_t>();
  look.has_unread_texture = !look.image;
  if (texture.contains("sampler")) look.sampler = file.at("samplers").at(texture["sampler"].get<std::size_t>());
  return look;
}

std::vector<glm::vec2> read_gltf_uvs(const GltfAsset& asset, const Json& attributes, const GltfLook& look, std::size_t count) {
  std::vector<glm::vec2> uvs;
  if (!look.image || !attributes.contains(look.uv_name)) return uvs;
  const std::vector<double> values = asset.read_accessor(attributes[look.uv_name].get<std::size_t>(), 2);
  const double sine = std::sin(look.rotation_rad), cosine = std::cos(look.rotation_rad);
  for (std::size_t i = 0; i + 1 < values.size() && i / 2 < count; i += 2) {
    const double u = values[i] * look.scale.x, v = values[i + 1] * look.scale.y;
    uvs.emplace_back(bounded_number(cosine * u + sine * v + look.offset.x, -kLargestUv, kLargestUv),
                     bounded_number(-sine * u + cosine * v + look.offset.y, -kLargestUv, kLargestUv));
  }
  return uvs;
}

std::vector<glm::vec3> read_gltf_colors(const GltfAsset& asset, const Json& attributes, std::size_t count) {
  std::vector<glm::vec3> colors;
  if (!attributes.contains("COLOR_0")) return colors;
  const auto accessor = attributes["COLOR_0"].get<std::size_t>();
  const std::size_t components = asset.json().at("accessors").at(accessor).value("type", "") == "VEC4" ? 4 : 3;
  const std::vector<double> values = asset.read_accessor(accessor, components);
  for (std::size_t i = 0; i + components <= values.size() && colors.size() < count; i += components)
    colors.emplace_back(bounded_number(values[i], 0, 1), bounded_number(values[i + 1], 0, 1), bounded_number(values[i + 2], 0, 1));
  return colors;
}

TextureWrap gltf_wrap(const Json& sampler, const char* key) {
  constexpr std::uint64_t clamp_to_edge = 33071, mirrored_repeat = 33648;
  const auto code = sampler.value(key, std::uint64_t{10497});
  return code == clamp_to_edge ? TextureWrap::clamp : code == mirrored_repeat ? TextureWrap::mirror : TextureWrap::repeat;
}

float bounded_number(double value, double lower, double upper) {
  return std::isfinite(value) ? static_cast<float>(std::min(std::max(value, lower), upper)) : 0.f;
}

}  // namespace earshot
