// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <string>
#include <vector>

namespace earshot {

/// One part of an OBJ, PLY or STL file: positions in the axes and units of the file, faces cut into triangles.
struct MeshPart {
  std::string object, material;
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> corners;  ///< three per triangle, indices into positions
  bool has_floats = false;             ///< the file holds its positions as floats of four bytes
  /// Number that the face of each triangle carries (object_id or face_segment of a PLY), -1 for none; empty where no face has one.
  std::vector<std::int64_t> triangle_ids = {};
  // What it looks like, where that was asked for.  As in the file: encoded colours, v upwards.
  std::vector<glm::vec2> uvs = {};         ///< per position, or empty
  std::vector<glm::vec3> colors = {};      ///< per position, or empty
  std::vector<glm::vec3> base_color = {};  ///< one, or none
  std::string texture = {};                ///< file beside the mesh, or empty
};

/// What a reader found in the bytes of a mesh file.
struct MeshFile {
  std::vector<MeshPart> parts;
  std::uint64_t num_faces = 0;        ///< polygons and strips as parsed, before they are cut into triangles
  std::vector<std::string> warnings;  ///< one line each
  /// Warnings where the mesh is open: signs of a file that was cut off, which a whole file may have too.
  std::vector<std::string> doubts = {};
};

/// Cuts the faces of one file into triangles (polygon.h).
class FaceCutter {
 public:
  /// where: the file, for messages.
  explicit FaceCutter(std::string where) : where_(std::move(where)) {}

  /// Appends the triangles of a polygon to part.corners.  Faces of fewer than three corners have no surface: they are counted.
  /// Throws InputError for a corner past the positions and for more than largest_polygon corners.
  void add(std::span<const std::uint32_t> face, MeshPart& part);
  [[nodiscard]] std::uint64_t num_faces() const { return num_faces_; }
  /// Faces that were points or lines, as a warning; empty if there were none.
  [[nodiscard]] std::string warning() const;

 private:
  std::string where_;
  std::uint64_t num_faces_ = 0, num_without_surface_ = 0;
  std::vector<glm::vec3> polygon_;
  std::vector<std::uint32_t> cut_;
};

}  // namespace earshot
