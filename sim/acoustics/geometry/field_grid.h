#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <span>
#include <vector>

#include "sim/scene/scene.h"

namespace earshot {

/// The air of a scene cut into cells that share a history of energy: boxes of a grid, and where walls cut a box into pieces, one cell for
/// each piece.  Pieces that are joined inside the box by a slit alone, narrower than about a quarter of its edge, are apart as well.  So
/// nothing leaks from room to room: through slits and ajar doors goes what photons carry through them.  Immutable.
class FieldGrid {
 public:
  static constexpr std::uint32_t none = 0xFFFFFFFFu;

  /// cell_m: about the edge of the boxes, which fill the bounds of the scene exactly; larger where that would give more than 16,384.  A
  /// function of scene and cell_m.  Cost: about 0.15 ms for each box that holds geometry, in parallel.
  FieldGrid(const Scene& scene, float cell_m);

  [[nodiscard]] std::size_t size() const { return cells_.size(); }
  [[nodiscard]] glm::vec3 edge_m() const { return edge_m_; }                                 ///< of a whole box
  [[nodiscard]] glm::vec3 inside(std::uint32_t cell) const { return cells_[cell].view[0]; }  ///< a point of the cell
  [[nodiscard]] float volume_m3(std::uint32_t cell) const { return cells_[cell].volume_m3; }

  /// A segment of a ray inside one cell, metres from its origin.
  struct Crossing {
    std::uint32_t cell;
    float enter_m, leave_m;
  };
  /// Appends the cells that a segment crosses.  A segment is free of geometry between its ends, so it counts for one piece of each box;
  /// which, short rays decide near the walls between pieces.
  void cross(glm::vec3 origin, glm::vec3 direction, float length_m, std::vector<Crossing>& crossings) const;

  struct CellWeight {
    std::uint32_t cell;
    float weight;
  };
  /// The cells round a point that are visible from it and that passages join to its own cell, with the weights of trilinear interpolation
  /// between the centres of their boxes; weights add up to 1.  Returns how many; 0 only in an empty scene.  A point outside of the bounds
  /// of the scene gets the cells at the border.  Cost: up to some tens of short rays.
  std::size_t blend(glm::vec3 point, std::array<CellWeight, 8>& weights) const;

  /// Two cells of adjacent boxes with more than a slit between them.
  struct Passage {
    std::uint32_t first, second;  ///< first < second
    float openness;               ///< [0.25, 1]: fraction of short lines across their common face that geometry does not cut
  };
  /// Every passage once, in ascending order of (first, second).
  [[nodiscard]] std::span<const Passage> passages() const { return passages_; }

 private:
  static constexpr std::size_t kViews = 6;
  struct Cell {
    float volume_m3 = 0;
    std::uint32_t num_views = 0;
    std::array<glm::vec3, kViews> view{};  ///< points of the piece, spread over it
    glm::vec3 lower{0}, upper{0};          ///< bounds of the piece, where it is one of several: no point of it lies outside
  };
  struct Box {
    std::uint32_t first = 0, count = 0;  ///< its cells
    std::uint32_t labels = none;         ///< of its points, in labels_; none: they are all of one cell
    std::uint32_t stray = none;          ///< bounds of its air that is of no cell, in stray_; none: there is none
  };
  /// The pieces of a box, and of which its points are.
  struct Pieces {
    std::vector<Cell> cells;
    std::vector<std::uint8_t> label;  ///< [points]; kNoPiece: of none
  };
  [[nodiscard]] std::size_t box_at(const glm::ivec3& index) const {
    return (static_cast<std::size_t>(index.x) * static_cast<std::size_t>(count_.y) + static_cast<std::size_t>(index.y)) *
               static_cast<std::size_t>(count_.z) +
           static_cast<std::size_t>(index.z);
  }
  [[nodiscard]] bool visible_from(const Cell& cell, glm::vec3 point) const;
  [[nodiscard]] glm::ivec3 index_of(std::size_t box) const;
  [[nodiscard]] glm::vec3 point_of(const glm::ivec3& box, const glm::ivec3& at) const;
  [[nodiscard]] std::uint32_t piece_at(std::size_t box, glm::vec3 point) const;
  [[nodiscard]] glm::ivec3 place_in(std::size_t box, glm::vec3 point) const;
  [[nodiscard]] std::uint32_t sure_piece_at(std::size_t box, glm::vec3 point) const;
  [[nodiscard]] std::uint32_t piece_along(std::size_t box, glm::vec3 enter, glm::vec3 leave) const;
  [[nodiscard]] std::uint32_t piece_near_walls(std::size_t box, glm::vec3 point) const;
  [[nodiscard]] bool joined(std::uint32_t cell, std::uint32_t other) const;
  [[nodiscard]] std::vector<bool> boxes_with_geometry() const;
  [[nodiscard]] Pieces pieces_of(const glm::ivec3& index) const;
  void find_stray_air();
  [[nodiscard]] std::uint32_t cell_of(const Box& box, int number) const;
  void find_passages_between(const glm::ivec3& index, int axis, std::vector<Passage>& found) const;
  void find_passages(const std::vector<bool>& holds_geometry);

  const Scene* scene_;
  glm::vec3 origin_{0}, edge_m_{1};
  glm::ivec3 count_{0};
  std::vector<Box> boxes_;
  std::vector<Cell> cells_;
  std::vector<std::uint8_t> labels_;  ///< [boxes whose points are not all of one piece][points]
  std::vector<Bounds> stray_;
  std::vector<Passage> passages_;                ///< ascending
  std::vector<std::uint32_t> neighbours_begin_;  ///< [cells + 1], in neighbours_
  std::vector<std::uint32_t> neighbours_;        ///< cells that passages join to each, ascending
};

}  // namespace earshot
