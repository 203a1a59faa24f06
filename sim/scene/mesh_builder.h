#pragma once

#include <cstdint>
#include <glm/mat4x4.hpp>
#include <span>
#include <string>
#include <unordered_map>

#include "sim/scene/triangle_mesh.h"

namespace earshot {

/// Appends the parts of a mesh file to a TriangleMesh and checks them; shared by the readers of all formats.
class MeshBuilder {
 public:
  /// where: the file, for messages.
  MeshBuilder(std::string where, TriangleMesh& mesh) : where_(std::move(where)), mesh_(mesh) {}

  /// positions in the part's own frame; corners: three per triangle, indices into positions.
  /// Throws InputError for a position that is not finite, or beyond 1e9 m, after the transform and for an index out of range.
  void append(const std::string& object, const std::string& material, const glm::dmat4& to_world, std::span<const glm::vec3> positions,
              std::span<const std::uint32_t> corners);

 private:
  using Index = std::unordered_map<std::string, std::uint32_t>;
  static std::uint32_t intern_fast(std::vector<std::string>& names, Index& index, const std::string& name);

  std::string where_;
  TriangleMesh& mesh_;
  Index materials_, objects_;
};

/// Text of others for a message of one line: no control characters, 200 bytes at most.
std::string one_line(std::string text);

}  // namespace earshot
