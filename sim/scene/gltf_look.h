// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "sim/scene/readers/gltf_buffers.h"
#include "sim/scene/texture.h"

namespace earshot {

/// Base colour and texture of one material of a glTF file.
struct GltfLook {
  std::optional<glm::vec3> base_color;
  std::optional<std::size_t> image;
  bool has_unread_texture = false;  ///< only in a format of an extension
  nlohmann::json sampler = nlohmann::json::object();
  std::string uv_name = "TEXCOORD_0";
  // KHR_texture_transform: uv * scale, turned, plus offset.
  glm::dvec2 offset{0}, scale{1};
  double rotation_rad = 0;
};

// Of the JSON of a file and of one primitive.  Throw InputError for damaged accessors; nlohmann::json exceptions and std::out_of_range may
// pass: visit_gltf turns them into InputError.

/// Look of the material of the primitive; the default where it has none.
GltfLook read_gltf_look(const nlohmann::json& file, const nlohmann::json& primitive);
/// Texture coordinates of up to `count` vertices, v downwards, within [-kLargestUv, kLargestUv]; empty where there are none.
std::vector<glm::vec2> read_gltf_uvs(const GltfAsset& asset, const nlohmann::json& attributes, const GltfLook& look, std::size_t count);
/// COLOR_0 of up to `count` vertices, [0, 1], as it stands in the file; empty where there is none.
std::vector<glm::vec3> read_gltf_colors(const GltfAsset& asset, const nlohmann::json& attributes, std::size_t count);
/// key: wrapS or wrapT.
TextureWrap gltf_wrap(const nlohmann::json& sampler, const char* key);

constexpr double kLargestUv = 65536;  ///< as sample_bilinear
/// A number of a file as a float in [lower, upper]; an invalid number becomes zero.
float bounded_number(double value, double lower, double upper);

}  // namespace earshot
