// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/visual_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <utility>

#include "sim/base/coordinates.h"
#include "sim/base/errors.h"
#include "sim/base/files.h"
#include "sim/base/text/json.h"
#include "sim/base/text/listed.h"
#include "sim/base/text/text_match.h"
#include "sim/scene/color.h"
#include "sim/scene/gltf_look.h"
#include "sim/scene/readers/gltf_reader.h"
#include "sim/scene/readers/mesh_builder.h"
#include "sim/scene/readers/mesh_file.h"
#include "sim/scene/texel.h"

namespace earshot {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kLargestTextureFile = std::size_t{512} << 20;
constexpr std::size_t kMaxTextureNames = 4;  // in a warning

glm::vec3 decode_srgb(glm::vec3 encoded) {
  const auto decode = [](float value) { return earshot::decode_srgb(bounded_number(double{value}, 0, 1)); };
  return {decode(encoded.x), decode(encoded.y), decode(encoded.z)};
}

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
    if (!is_texture(bytes)) {
      leave_out(fmt::format("texture {}", key));
      return Paint::no_texture;
    }
    Texture decoded = decode_texture(bytes, fmt::format("{}: texture {}", where_, key), largest_texture_px_);
    decoded.wrap_u = wrap_u;
    decoded.wrap_v = wrap_v;
    found->second = static_cast<std::uint32_t>(mesh_.textures.size());
    mesh_.textures.push_back(std::move(decoded));
    return found->second;
  }

  /// A texture that is not read.
  void leave_out(const std::string& name) { left_out_.push_back(name); }
  void finish() {
    if (left_out_.empty()) return;
    const std::size_t count = left_out_.size();
    if (count > kMaxTextureNames) left_out_.resize(kMaxTextureNames);
    mesh_.warnings.push_back(
        fmt::format("{}: textures that are neither PNG nor JPEG are left out: {} ({}{}); their surfaces use their base color", where_,
                    count, listed(left_out_, ", "), count > kMaxTextureNames ? ", ..." : ""));
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
  std::vector<std::string> left_out_;
};

void read_gltf_looks(const std::filesystem::path& path, const glm::dmat4& to_world, VisualMeshBuilder& builder, VisualMesh& mesh) {
  visit_gltf(path, to_world, [&](const GltfPrimitive& part) {
    const Json& attributes = part.json.at("attributes");
    const GltfLook look = read_gltf_look(part.asset.json(), part.json);
    if (look.base_color) mesh.color_of_material.try_emplace(part.material, *look.base_color);
    const std::string key = part.json.contains("material") ? json_text(part.json["material"]) : "none";
    const std::uint32_t paint = builder.paint(key, [&] {
      Paint made{.base_color = look.base_color.value_or(glm::vec3(1))};
      if (look.has_unread_texture) builder.leave_out(fmt::format("of material {}", one_line(part.material)));
      if (look.image)
        made.texture = builder.texture(
            fmt::format("{} {}", *look.image, json_text(look.sampler)), [&] { return part.asset.read_image(*look.image); },
            gltf_wrap(look.sampler, "wrapS"), gltf_wrap(look.sampler, "wrapT"));
      return made;
    });
    builder.append(part.object, part.to_world, part.positions, part.corners,
                   read_gltf_uvs(part.asset, attributes, look, part.positions.size()),
                   read_gltf_colors(part.asset, attributes, part.positions.size()), paint);
  });
}

void read_file_looks(const std::filesystem::path& path, const glm::dmat4& to_world, VisualMeshBuilder& builder, VisualMesh& mesh) {
  for (const MeshPart& part : read_mesh_file(path, true).parts) {
    const std::size_t count = part.positions.size();
    std::vector<glm::vec2> uvs;
    // Coordinates of these formats count v upwards, rows of a picture count down.
    for (std::size_t i = 0; i < std::min(part.uvs.size(), count); ++i)
      uvs.emplace_back(bounded_number(part.uvs[i].x, -kLargestUv, kLargestUv),
                       bounded_number(1.0 - part.uvs[i].y, -kLargestUv, kLargestUv));
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
  builder.finish();
  return mesh;
}

}  // namespace earshot
