#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "sim/scene/readers/mesh_builder.h"

namespace earshot {

/// One part of a mesh file: positions in its own frame, cut into triangles.
struct MeshPart {
  std::string object, material;
  glm::dmat4 to_file{1};  ///< from the part's frame to that of the file
  std::vector<glm::vec3> positions;
  std::vector<std::uint32_t> corners;  ///< three per triangle, indices into positions
  // What it looks like, where that was asked for.  As in the file: encoded colours, v upwards.
  std::vector<glm::vec2> uvs = {};         ///< per position, or empty
  std::vector<glm::vec3> colors = {};      ///< per position, or empty
  std::vector<glm::vec3> base_color = {};  ///< one, or none
  std::string texture = {};                ///< file beside the mesh, or empty
};

/// Gives the builder the triangles of an OBJ, PLY or STL file.  Assimp reads it in a process of its own (isolated_call.h): release 5.2
/// crashes on some damaged files, loops on others, and allocates whatever count it reads.
/// Throws InputError naming the file; RunError if that process cannot be started.
void read_with_assimp(const std::filesystem::path& path, const glm::dmat4& file_to_world, MeshBuilder& builder);

/// The parts with what they look like, read by that process too.
std::vector<MeshPart> read_visual_parts(const std::filesystem::path& path);

/// Within this process: for earshot_reader.
std::vector<MeshPart> read_parts_with_assimp(const std::filesystem::path& path, bool with_looks = false);

/// Parts as bytes, for the answer of that process.  decode_parts throws InputError naming `where` for bytes that encode_parts does not
/// make; the builder checks indices and coordinates.
std::string encode_parts(const std::vector<MeshPart>& parts);
std::vector<MeshPart> decode_parts(std::string_view bytes, const std::string& where);

}  // namespace earshot
