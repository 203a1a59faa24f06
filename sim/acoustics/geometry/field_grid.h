// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/air_cells.h"
#include "sim/acoustics/geometry/cell_passages.h"
#include "sim/base/memory_bytes.h"
#include "sim/scene/scene.h"

namespace earshot {

/// The air of a scene cut into cells that share a history of energy: boxes of a grid, and where walls cut a box into pieces, one cell for
/// each piece.  Pieces that are joined inside the box by a slit alone, narrower than about a quarter of its edge, are apart as well.  So no
/// energy leaks between rooms: only photons carry energy through slits and ajar doors.  Immutable.
/// box_pieces.h defines the pieces of a box, air_cells.h finds the piece at a point, cell_passages.h joins pieces.
class FieldGrid {
 public:
  static constexpr std::uint32_t no_cell = AirCells::no_index;
  /// In place of a cell: air of no cell, as in gaps behind furniture.
  static constexpr std::uint32_t gap = no_cell - 1;

  /// Keeps a reference to `scene`, which must outlive this.  cell_m: about the edge of the boxes, which fill the bounds of the scene
  /// exactly; larger where that would give more than 16,384.  A function of scene and cell_m.  Cost: about 0.15 ms for each box that holds
  /// geometry, in parallel.
  FieldGrid(const Scene& scene, float cell_m);

  [[nodiscard]] std::size_t size() const { return cells_.size(); }
  [[nodiscard]] std::size_t bytes() const { return cells_.bytes() + passages_.bytes() + bytes_of(room_) + num_rooms_ / 8; }  ///< of memory
  [[nodiscard]] glm::vec3 edge_m() const { return cells_.boxes().edge_m(); }                 ///< of a whole box
  [[nodiscard]] glm::vec3 inside(std::uint32_t cell) const { return cells_[cell].view[0]; }  ///< a point of the cell
  [[nodiscard]] float volume_m3(std::uint32_t cell) const { return cells_[cell].volume_m3; }

  /// In place of a room: that of a cell of a pocket of air too small to be one.
  static constexpr std::uint32_t no_room = no_cell;
  /// Cells that passages join make a room if they hold at least 1 m3 together.  Sound goes from one room to another through walls and slits
  /// alone.
  [[nodiscard]] std::uint32_t room(std::uint32_t cell) const { return room_[cell]; }
  [[nodiscard]] std::uint32_t num_rooms() const { return num_rooms_; }
  /// Is a room the inside of a body, as of a wardrobe or of a wall of two faces?  From there two thirds of what is in sight or more turn
  /// the other side of their triangles than in most of the air, within 1.2 m in the mean, and at most one room lies behind it.  Of no room
  /// where the walls of most air turn both sides to it.
  [[nodiscard]] bool inside_body(std::uint32_t room) const { return inside_body_[room]; }

  /// A segment of a ray inside one cell, metres from its origin.
  struct Crossing {
    std::uint32_t cell;
    float enter_m, leave_m;
  };
  /// Appends the cells that a segment crosses.  A segment is free of geometry between its ends, so it counts for one piece of each box, or
  /// where it goes through a slit for two: near the walls between pieces the one that a passage joins to the cell before it, and where that
  /// is none or several, short rays decide. start: the cell at the start of the segment, gap, or no_cell if unknown.  Returns the cell at
  /// its end.
  std::uint32_t cross(glm::vec3 origin, glm::vec3 direction, float length_m, std::vector<Crossing>& crossings,
                      std::uint32_t start = no_cell) const;

  struct CellWeight {
    std::uint32_t cell;
    float weight;
  };
  /// The cells round a point that are visible from it and that passages join to its own cell, with the weights of trilinear interpolation
  /// between the centres of their boxes; weights add up to 1.  Returns how many; 0 only in an empty scene.  A point outside of the bounds
  /// of the scene gets the cells at the border.  Cost: up to some tens of short rays.
  std::size_t blend(glm::vec3 point, std::array<CellWeight, 8>& weights) const;

  /// Is some view point of a cell visible from a point?
  [[nodiscard]] bool visible_from(std::uint32_t cell, glm::vec3 point) const { return cells_.visible_from(cell, point); }

  using Passage = CellPassage;
  /// Every passage once, in ascending order of (first, second).
  [[nodiscard]] std::span<const Passage> passages() const { return passages_.all(); }

 private:
  void find_rooms();
  void find_bodies(const Scene& scene);
  [[nodiscard]] bool leads_between_rooms(const Scene& scene, std::span<const std::uint32_t> cells, const std::vector<bool>& turned) const;
  [[nodiscard]] std::uint32_t cell_after(std::uint32_t previous_cell, std::uint32_t known, std::size_t box, glm::vec3 enter,
                                         glm::vec3 leave) const;

  AirCells cells_;
  CellPassages passages_;
  std::vector<std::uint32_t> room_;  ///< [cells]
  std::uint32_t num_rooms_ = 0;
  std::vector<bool> inside_body_;  ///< [rooms]
};

}  // namespace earshot
