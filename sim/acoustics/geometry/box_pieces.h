#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/geometry/field_boxes.h"
#include "sim/scene/scene.h"

namespace earshot {

/// A piece of the air of a box.
struct AirPiece {
  static constexpr std::size_t kViews = 6;
  float volume_m3 = 0;
  std::uint32_t num_views = 0;
  std::array<glm::vec3, kViews> view{};  ///< points of the piece, spread over it
  glm::vec3 lower{0}, upper{0};          ///< bounds of the piece, where it is one of several: no point of it lies outside
};

/// The pieces of a box, largest first, and of which of them its lattice points are.
struct BoxPieces {
  /// Label of points that belong to no piece: inside of something, or in a thin layer of air beside a wall at the border of the box.
  static constexpr std::uint8_t kNoPiece = 0xFF;
  std::vector<AirPiece> pieces;
  std::vector<std::uint8_t> label;  ///< [FieldBoxes::kPoints] index in `pieces`, or kNoPiece; empty: all points are of the only piece
};

/// A box without geometry: one piece.
BoxPieces whole_box(const FieldBoxes& boxes, const glm::ivec3& index);

/// Groups of points of a box that see each other, from neighbour to neighbour, through more than a slit: three by three lines side by side.
/// Pieces of fewer than 12 of the 512 points are left out: gaps behind furniture or the inside of walls, too small to know their volume.
/// Cost: about 0.1 ms, 1,500 short rays.
BoxPieces find_box_pieces(const Scene& scene, const FieldBoxes& boxes, const glm::ivec3& index);

}  // namespace earshot
