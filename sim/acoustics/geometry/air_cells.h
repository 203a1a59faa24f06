// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/box_pieces.h"
#include "sim/acoustics/geometry/field_boxes.h"
#include "sim/acoustics/geometry/wall_parts.h"
#include "sim/base/memory_bytes.h"
#include "sim/scene/scene.h"

namespace earshot {

/// The pieces of all boxes of a scene, as cells with one numbering, and which of them holds a point.  Immutable; safe from any thread.
class AirCells {
 public:
  static constexpr std::uint32_t no_index = 0xFFFFFFFFu;
  /// In place of a cell: known to lie outside all cells.
  static constexpr std::uint32_t outside_cells = no_index - 1;

  /// A box: its cells, and the labels that assign its air to them.
  struct Box {
    std::uint32_t first = 0, count = 0;    ///< its cells
    std::uint32_t labels = no_index;       ///< of its points, in labels_; none: they are all of one cell
    std::uint32_t part_labels = no_index;  ///< labels of its parts, in part_labels_; no_index where it is whole
    std::uint32_t stray = no_index;        ///< bounds of its air outside all cells, in stray_; no_index without any
    bool is_whole = false;                 ///< all of its air is of its only cell, and no wall reaches into it
  };

  /// Keeps a reference to `scene`, which must outlive this.  cell_m: about the edge of the boxes.  A scene without triangles has no cells.
  /// Cost: about 0.1 ms for each box that holds geometry, in parallel.
  AirCells(const Scene& scene, float cell_m);

  [[nodiscard]] const FieldBoxes& boxes() const { return boxes_; }
  [[nodiscard]] const Box& box(std::size_t number) const { return box_[number]; }
  [[nodiscard]] std::size_t size() const { return cells_.size(); }
  [[nodiscard]] std::size_t bytes() const {
    return bytes_of(box_) + bytes_of(cells_) + bytes_of(labels_) + bytes_of(part_labels_) + bytes_of(open_across_) + bytes_of(stray_);
  }
  [[nodiscard]] const AirPiece& operator[](std::uint32_t cell) const { return cells_[cell]; }

  /// The cell of the box that holds a point; no_index outside all cells.  Rays, up to 27, near the walls between cells alone.
  [[nodiscard]] std::uint32_t cell_at(std::size_t box, glm::vec3 point) const;
  /// The cells of the box, which has these indices, that a segment free of geometry crosses between two of its points: that of its first
  /// half and that of its second, which differ where it goes through a slit.  outside_cells, or none, as far as that is not known without a
  /// ray.
  [[nodiscard]] std::array<std::uint32_t, 2> known_cells_along(std::size_t box, const glm::ivec3& index, glm::vec3 enter,
                                                               glm::vec3 leave) const {
    if (box_[box].is_whole) return {box_[box].first, box_[box].first};
    return known_cells_beside_walls(box_[box], index, enter, leave);
  }
  /// The lines to the next box along an axis that belong to an opening wider than a slit, as in OpenWindows::across.
  [[nodiscard]] std::uint64_t open_across(std::size_t box, int axis) const { return open_across_[box][static_cast<std::size_t>(axis)]; }
  /// May air of no cell lie about this point of a box?
  [[nodiscard]] bool may_be_stray(std::size_t box, glm::vec3 point) const;
  /// The cell of one of the lattice points of a box.
  [[nodiscard]] std::uint32_t cell_of_lattice(std::size_t box, int number) const;
  /// Is some view point of a cell visible from a point?
  [[nodiscard]] bool visible_from(std::uint32_t cell, glm::vec3 point) const;

 private:
  /// Label of air that is of no piece, but is joined to the air of a neighbouring box.
  static constexpr std::uint8_t kStrayAir = 0xFE;
  static constexpr std::uint8_t kBesideWall = 0xFD;
  void find_pieces(const WallParts& walls);
  void find_part_labels(const WallParts& walls);
  void find_stray_air();
  [[nodiscard]] std::uint32_t known_cell_at(const Box& box, const glm::ivec3& index, glm::vec3 point) const;
  [[nodiscard]] std::array<std::uint32_t, 2> known_cells_beside_walls(const Box& box, const glm::ivec3& index, glm::vec3 enter,
                                                                      glm::vec3 leave) const;
  [[nodiscard]] std::uint32_t cell_near_walls(std::size_t box, glm::vec3 point) const;

  const Scene* scene_;
  FieldBoxes boxes_;
  std::vector<Box> box_;
  std::vector<AirPiece> cells_;
  std::vector<std::uint8_t> labels_;  ///< [boxes whose points are not all of one piece][points]
  std::vector<std::uint8_t>
      part_labels_;  ///< [boxes that walls reach into][parts], kBesideWall where the label of the point is not that of all
  std::vector<std::array<std::uint64_t, 3>> open_across_;  ///< [box][axis]
  std::vector<Bounds> stray_;
};

}  // namespace earshot
