// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/visual_mesh.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <utility>

#include "sim/base/coordinates.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/color.h"
#include "sim/scene/readers/gltf_reader.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/mesh_file.h"

namespace earshot {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kLargestTextureFile = std::size_t{512} << 20;

/// Numbers of a file as a float in [lower, upper]; an invalid number becomes zero.
float bounded(double value, double lower, double upper) {
  return std::isfinite(value) ? static_cast<float>(std::min(std::max(value, lower), upper)) : 0.f;
}

glm::vec3 decode_srgb(glm::vec3 encoded) {
  const auto decode = [](float value) { return earshot::decode_srgb(bounded(double{value}, 0, 1)); };
  return {decode(encoded.x), decode(encoded.y), decode(encoded.z)};
}

constexpr double kLargestUv = 65536;  // as sample_bilinear

/// Collects parts; shared by both formats.
class VisualMeshBuilder {
 public:
  VisualMeshBuilder(std::string where, glm::dvec3 origin_m, int largest_texture_px, VisualMesh& mesh)
      : where_(std::move(where)), origin_m_(origin_m), largest_texture_px_(largest_texture_px), mesh_(mesh) {}

  /// Index of the paint, made once per key.
  template <class Make>
  std::uint32_t paint(const std::string& key, Make make) {
    const auto [found, is_new] = paint_of_key_.try_emplace(key, static_cast<std::uint32_t>(mesh_.paints.size()));
    if (is_new) mesh_.paints.push_back(make());
    return found->second;
  }
  /// Index of the texture, decoded once per key; no_texture with a warning for a format that is not read.
  template <class Read>
  std::uint32_t texture(const std::string& key, Read read, TextureWrap wrap_u, TextureWrap wrap_v) {
    const auto [found, is_new] = texture_of_key_.try_emplace(key, Paint::no_texture);
    if (!is_new) return found->second;
    const std::string bytes = read();
    if (!bytes.starts_with("\x89PNG") && !bytes.starts_with("\xFF\xD8")) {
      mesh_.warnings.push_back(fmt::format("{}: texture {} is neither PNG nor JPEG; its surfaces use their base color", where_, key));
      return Paint::no_texture;
    }
    Texture decoded = decode_texture(bytes, fmt::format("{}: texture {}", where_, key), largest_texture_px_);
    decoded.wrap_u = wrap_u;
    decoded.wrap_v = wrap_v;
    found->second = static_cast<std::uint32_t>(mesh_.textures.size());
    mesh_.textures.push_back(std::move(decoded));
    return found->second;
  }

  void append(const std::string& object, const glm::dmat4& to_world, std::span<const glm::dvec3> positions,
              std::span<const std::uint32_t> corners, std::span<const glm::vec2> uvs, std::span<const glm::vec3> colors,
              std::uint32_t paint_index) {
    const std::size_t first = mesh_.vertices.size();
    if (first + positions.size() >= 0xFFFFFFFFu) throw InputError(where_, "has more than 4 billion vertices", "simplify it");
    for (const glm::dvec3 position : positions) {
      const glm::dvec3 world = to_world * glm::dvec4(position, 1.0);
      if (!is_valid_position(world))
        throw InputError(where_, fmt::format("a vertex of '{}' is not finite or too far from the origin", one_line(object)),
                         "repair the mesh");
      mesh_.vertices.emplace_back(world - origin_m_);
    }
    mesh_.uvs.insert(mesh_.uvs.end(), uvs.begin(), uvs.end());
    mesh_.uvs.resize(mesh_.vertices.size(), glm::vec2(0));
    mesh_.colors.insert(mesh_.colors.end(), colors.begin(), colors.end());
    mesh_.colors.resize(mesh_.vertices.size(), glm::vec3(1));
    const auto base = static_cast<std::uint32_t>(first);
    for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
      const glm::uvec3 triangle(corners[i], corners[i + 1], corners[i + 2]);
      for (int corner = 0; corner < 3; ++corner)
        if (triangle[corner] >= positions.size())
          throw InputError(where_, fmt::format("a triangle of '{}' uses a vertex that does not exist", one_line(object)),
                           "repair the mesh");
      mesh_.triangles.push_back(triangle + base);
      mesh_.triangle_paint.push_back(paint_index);
    }
    mesh_.varies = mesh_.varies || !colors.empty() || mesh_.paints[paint_index].texture != Paint::no_texture;
  }

 private:
  std::string where_;
  glm::dvec3 origin_m_;
  int largest_texture_px_;
  VisualMesh& mesh_;
  std::map<std::string, std::uint32_t> paint_of_key_, texture_of_key_;
};

TextureWrap gltf_wrap(const Json& sampler, const char* key) {
  constexpr std::uint64_t clamp_to_edge = 33071, mirrored_repeat = 33648;
  const auto code = sampler.value(key, std::uint64_t{10497});
  return code == clamp_to_edge ? TextureWrap::clamp : code == mirrored_repeat ? TextureWrap::mirror : TextureWrap::repeat;
}

/// Base colour and texture of one material of a glTF file.
struct GltfLook {
  std::optional<glm::vec3> base_color;
  std::optional<std::size_t> image;
  bool has_unread_texture = false;  ///< only in a format of an extension
  Json sampler = Json::object();
  std::string uv_name = "TEXCOORD_0";
  // KHR_texture_transform: uv * scale, turned, plus offset.
  glm::dvec2 offset{0}, scale{1};
  double rotation_rad = 0;
};

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

GltfLook read_look(const Json& file, const Json& primitive) {
  GltfLook look;
  if (!primitive.contains("material")) return look;
  const Json& material = file.at("materials").at(primitive["material"].get<std::size_t>());
  if (!material.contains("pbrMetallicRoughness")) return look;
  const Json& surface = material["pbrMetallicRoughness"];
  if (surface.contains("baseColorFactor")) {
    const auto factor = surface["baseColorFactor"].get<std::array<double, 4>>();
    look.base_color = glm::vec3(bounded(factor[0], 0, 1), bounded(factor[1], 0, 1), bounded(factor[2], 0, 1));
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

std::vector<glm::vec2> read_uvs(const GltfAsset& asset, const Json& attributes, const GltfLook& look, std::size_t count) {
  std::vector<glm::vec2> uvs;
  if (!look.image || !attributes.contains(look.uv_name)) return uvs;
  const std::vector<double> values = asset.read_accessor(attributes[look.uv_name].get<std::size_t>(), 2);
  const double sine = std::sin(look.rotation_rad), cosine = std::cos(look.rotation_rad);
  for (std::size_t i = 0; i + 1 < values.size() && i / 2 < count; i += 2) {
    const double u = values[i] * look.scale.x, v = values[i + 1] * look.scale.y;
    uvs.emplace_back(bounded(cosine * u + sine * v + look.offset.x, -kLargestUv, kLargestUv),
                     bounded(-sine * u + cosine * v + look.offset.y, -kLargestUv, kLargestUv));
  }
  return uvs;
}

std::vector<glm::vec3> read_colors(const GltfAsset& asset, const Json& attributes, std::size_t count) {
  std::vector<glm::vec3> colors;
  if (!attributes.contains("COLOR_0")) return colors;
  const auto accessor = attributes["COLOR_0"].get<std::size_t>();
  const std::size_t components = asset.json().at("accessors").at(accessor).value("type", "") == "VEC4" ? 4 : 3;
  const std::vector<double> values = asset.read_accessor(accessor, components);
  for (std::size_t i = 0; i + components <= values.size() && colors.size() < count; i += components)
    colors.emplace_back(bounded(values[i], 0, 1), bounded(values[i + 1], 0, 1), bounded(values[i + 2], 0, 1));
  return colors;
}

void read_gltf_looks(const std::filesystem::path& path, const glm::dmat4& to_world, VisualMeshBuilder& builder, VisualMesh& mesh) {
  visit_gltf(path, to_world, [&](const GltfPrimitive& part) {
    const Json& attributes = part.json.at("attributes");
    const GltfLook look = read_look(part.asset.json(), part.json);
    if (look.base_color) mesh.color_of_material.try_emplace(part.material, *look.base_color);
    const std::string key = part.json.contains("material") ? json_text(part.json["material"]) : "none";
    const std::uint32_t paint = builder.paint(key, [&] {
      Paint made{.base_color = look.base_color.value_or(glm::vec3(1))};
      if (look.has_unread_texture)
        mesh.warnings.push_back(fmt::format("{}: the texture of material {} is neither PNG nor JPEG; its surfaces use their base color",
                                            path.string(), one_line(part.material)));
      if (look.image)
        made.texture = builder.texture(
            fmt::format("{} {}", *look.image, json_text(look.sampler)), [&] { return part.asset.read_image(*look.image); },
            gltf_wrap(look.sampler, "wrapS"), gltf_wrap(look.sampler, "wrapT"));
      return made;
    });
    builder.append(part.object, part.to_world, part.positions, part.corners, read_uvs(part.asset, attributes, look, part.positions.size()),
                   read_colors(part.asset, attributes, part.positions.size()), paint);
  });
}

void read_file_looks(const std::filesystem::path& path, const glm::dmat4& to_world, VisualMeshBuilder& builder, VisualMesh& mesh) {
  for (const MeshPart& part : read_mesh_file(path, true).parts) {
    const std::size_t count = part.positions.size();
    std::vector<glm::vec2> uvs;
    // Coordinates of these formats count v upwards, rows of a picture count down.
    for (std::size_t i = 0; i < std::min(part.uvs.size(), count); ++i)
      uvs.emplace_back(bounded(part.uvs[i].x, -kLargestUv, kLargestUv), bounded(1.0 - part.uvs[i].y, -kLargestUv, kLargestUv));
    std::vector<glm::vec3> colors;
    for (std::size_t i = 0; i < std::min(part.colors.size(), count); ++i) colors.push_back(decode_srgb(part.colors[i]));
    if (!part.base_color.empty()) mesh.color_of_material.try_emplace(part.material, decode_srgb(part.base_color.front()));
    const std::uint32_t paint = builder.paint(part.material, [&] {
      Paint made{.base_color = part.base_color.empty() ? glm::vec3(1) : decode_srgb(part.base_color.front())};
      if (!part.texture.empty())
        made.texture = builder.texture(
            one_line(part.texture), [&] { return read_file(path.parent_path() / part.texture, kLargestTextureFile); }, TextureWrap::repeat,
            TextureWrap::repeat);
      return made;
    });
    builder.append(part.object, to_world, part.positions, part.corners, uvs, colors, paint);
  }
}

}  // namespace

VisualMesh read_visual_mesh(const std::filesystem::path& path, const MeshImportOptions& options, glm::dvec3 origin_m,
                            int largest_texture_px) {
  VisualMesh mesh;
  VisualMeshBuilder builder(path.string(), origin_m, largest_texture_px, mesh);
  const std::string extension = fold_case(path.extension().string());
  const bool is_gltf = extension == ".glb" || extension == ".gltf";
  (is_gltf ? read_gltf_looks : read_file_looks)(path, file_to_world(options), builder, mesh);
  return mesh;
}

}  // namespace earshot
