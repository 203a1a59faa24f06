// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <string>
#include <vector>

#include "sim/scene/readers/mesh_import.h"
#include "sim/scene/texture.h"

namespace earshot {

/// Colour of a surface in linear light: base_color, times the texel where there is a texture, times the vertex colours where there are any.
struct Paint {
  static constexpr std::uint32_t no_texture = 0xFFFFFFFFu;
  glm::vec3 base_color{1};
  std::uint32_t texture = no_texture;  ///< index into the textures beside it
};

/// A mesh file as it looks: its own triangles, before repair and simplification.
struct VisualMesh {
  std::vector<glm::vec3> vertices;  ///< metres, relative to the origin that was asked for
  std::vector<glm::vec2> uvs;       ///< [vertices]; zero where the file has none
  std::vector<glm::vec3> colors;    ///< [vertices] linear; one where the file has none
  std::vector<glm::uvec3> triangles;
  std::vector<std::uint32_t> triangle_paint;
  std::vector<Paint> paints;
  std::vector<Texture> textures;
  bool varies = false;  ///< a texture or colours of vertices: the colour of a point is not that of its material alone
  /// Base colour, linear, of each material of the file that has one.
  std::map<std::string, glm::vec3> color_of_material;
  std::vector<std::string> warnings;  ///< textures that are not read, one line each
};

/// Reads a mesh file for its looks: base colours (glTF pbrMetallicRoughness, Kd of OBJ), colours of vertices (COLOR_0, PLY, OBJ), textures
/// as PNG and JPEG (baseColorTexture with KHR_texture_transform, map_Kd), by the coordinates TEXCOORD_n and vt.  Alpha, emission and normal
/// maps play no part.  largest_texture_px: texture.h.  Throws InputError as import_mesh does, and for textures that are missing or damaged.
/// About as long as import_mesh, and the textures.
VisualMesh read_visual_mesh(const std::filesystem::path& path, const MeshImportOptions& options, glm::dvec3 origin_m,
                            int largest_texture_px);

}  // namespace earshot
