// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/mat4x4.hpp>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "sim/scene/mesh/triangle_mesh.h"
#include "sim/scene/readers/surface_names.h"

namespace earshot {

/// Type of the numbers that a file holds its positions in; of a text doubles.
enum class PositionDigits { floats, doubles };

/// Makes a TriangleMesh of the parts of a mesh file and checks them; shared by the readers of all formats.  Positions stay double until all
/// parts are there and it is known where the mesh lies.
class MeshBuilder {
 public:
  /// where: the file, for messages.  mesh: empty.
  MeshBuilder(std::string where, TriangleMesh& mesh) : where_(std::move(where)), mesh_(mesh) {}

  /// positions in the part's own frame; corners: three per triangle, indices into positions.
  /// Throws InputError for a position that is not finite, or beyond kMaxCoordinateM (sim/base/coordinates.h), after the transform and for
  /// an index out of range.
  void append(const std::string& object, const std::string& material, const glm::dmat4& to_world, std::span<const glm::dvec3> positions,
              std::span<const std::uint32_t> corners, PositionDigits digits);
  /// Gives the triangles of the last part the category as their material and the instance as their object.
  /// numbers: per triangle, an index into `names`.
  void name_last(std::span<const std::uint32_t> numbers, std::span<const SurfaceName> names);
  /// Writes the vertices and the origin of the mesh (origin_near, of the triangles).  Once, after the last part.
  void finish();
  /// Spacing of floats at the farthest position that was added as floats, in metres: the resolution of the file itself.
  [[nodiscard]] double position_step_m() const { return position_step_m_; }

 private:
  using Index = std::unordered_map<std::string, std::uint32_t>;
  [[nodiscard]] bool is_point_or_line(glm::uvec3 triangle) const;
  void drop_unused_names();
  static std::uint32_t intern_fast(std::vector<std::string>& names, Index& index, const std::string& name);

  std::string where_;
  TriangleMesh& mesh_;
  std::vector<glm::dvec3> world_;
  double position_step_m_ = 0;
  std::size_t first_of_part_ = 0;  ///< triangle of the last part
  bool has_names_ = false;         ///< by name_last
  Index materials_, objects_;
};

/// Text of a file for a message of one line: no control characters, 200 bytes at most.
std::string one_line(std::string text);

}  // namespace earshot
