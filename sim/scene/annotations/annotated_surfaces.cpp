// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/annotations/annotated_surfaces.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/scene/readers/gltf_reader.h"
#include "sim/scene/texel.h"

namespace earshot {
namespace {

constexpr int kLargestTexture = 8192;  // of decode_texture: a texture whose colours are numbers must not be halved

std::uint32_t color_of(std::array<std::uint8_t, 3> rgb) {
  return std::uint32_t{rgb[0]} << 16 | std::uint32_t{rgb[1]} << 8 | std::uint32_t{rgb[2]};
}

std::uint8_t byte_of(float value) { return static_cast<std::uint8_t>(std::lround(255.f * value)); }

/// The name that two of three corners have, else that of the first one.
std::uint32_t majority(std::uint32_t a, std::uint32_t b, std::uint32_t c) { return b == c ? b : a; }

}  // namespace

const Annotations& AnnotatedSurfaces::annotations() {
  if (!annotations_) annotations_ = read_annotations(files_.names);
  return *annotations_;
}

std::vector<std::uint32_t> AnnotatedSurfaces::of_faces(std::span<const std::int64_t> ids) {
  const Annotations& known = annotations();
  carries_ = true;
  std::vector<std::uint32_t> names;
  names.reserve(ids.size());
  for (const std::int64_t id : ids) names.push_back(id < 0 ? 0 : known.of_id(id));
  return names;
}

std::vector<std::uint32_t> AnnotatedSurfaces::of_primitive(const GltfPrimitive& primitive) {
  std::vector<std::uint32_t> names(primitive.corners.size() / 3, 0);
  if (!annotations().has_colors()) return names;
  name_by_vertex_colors(primitive, names);
  if (std::find(names.begin(), names.end(), 0u) != names.end()) name_by_texture(primitive, names);
  return names;
}

void AnnotatedSurfaces::name_by_vertex_colors(const GltfPrimitive& primitive, std::vector<std::uint32_t>& names) {
  std::vector<std::uint32_t> of_vertex;
  for (const glm::vec3 color : read_gltf_colors(primitive.asset, primitive.json.at("attributes"), primitive.positions.size()))
    of_vertex.push_back(annotations_->of_color(color_of({byte_of(color.x), byte_of(color.y), byte_of(color.z)})));
  if (of_vertex.empty()) return;
  carries_ = true;
  for (std::size_t t = 0; t < names.size(); ++t) {
    const std::array<std::uint32_t, 3> corners{primitive.corners[3 * t], primitive.corners[3 * t + 1], primitive.corners[3 * t + 2]};
    if (*std::max_element(corners.begin(), corners.end()) >= of_vertex.size()) continue;
    names[t] = majority(of_vertex[corners[0]], of_vertex[corners[1]], of_vertex[corners[2]]);
  }
}

void AnnotatedSurfaces::name_by_texture(const GltfPrimitive& primitive, std::vector<std::uint32_t>& names) {
  const GltfLook look = read_gltf_look(primitive.asset.json(), primitive.json);
  if (!look.image) return;
  const std::vector<glm::vec2> uvs = read_gltf_uvs(primitive.asset, primitive.json.at("attributes"), look, primitive.positions.size());
  const Texture* texture = uvs.empty() ? nullptr : texture_of(primitive.asset, look);
  if (texture == nullptr) return;
  carries_ = true;
  // The middle, and a point towards each corner.
  constexpr std::array<glm::vec3, 4> points{glm::vec3(1 / 3.f), {0.6f, 0.2f, 0.2f}, {0.2f, 0.6f, 0.2f}, {0.2f, 0.2f, 0.6f}};
  for (std::size_t t = 0; t < names.size(); ++t) {
    const glm::uvec3 corners(primitive.corners[3 * t], primitive.corners[3 * t + 1], primitive.corners[3 * t + 2]);
    if (names[t] != 0 || std::max({corners.x, corners.y, corners.z}) >= uvs.size()) continue;
    std::array<std::uint32_t, points.size()> found{};
    for (std::size_t p = 0; p < points.size(); ++p)
      found[p] = annotations_->of_color(
          color_of(nearest_texel(*texture, points[p].x * uvs[corners.x] + points[p].y * uvs[corners.y] + points[p].z * uvs[corners.z])));
    const auto votes = [&](std::uint32_t name) { return name == 0 ? 0 : std::count(found.begin(), found.end(), name); };
    names[t] = *std::max_element(found.begin(), found.end(), [&](std::uint32_t a, std::uint32_t b) { return votes(a) < votes(b); });
  }
}

const Texture* AnnotatedSurfaces::texture_of(const GltfAsset& asset, const GltfLook& look) {
  if (image_ != look.image) {
    image_ = look.image;
    texture_.reset();
    const std::string bytes = asset.read_image(*look.image);
    if (is_texture(bytes))
      texture_ = decode_texture(bytes, fmt::format("{}: texture {}", files_.carrier.string(), *look.image), kLargestTexture);
  }
  if (!texture_) return nullptr;
  texture_->wrap_u = gltf_wrap(look.sampler, "wrapS");
  texture_->wrap_v = gltf_wrap(look.sampler, "wrapT");
  return &*texture_;
}

}  // namespace earshot
