#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <span>
#include <vector>

#include "sim/scene/scene.h"

namespace earshot {

/// The air of a scene cut into cells that share a history of energy: boxes of a grid, and where walls cut a box into pieces that are not
/// connected inside it, one cell for each piece.  So nothing leaks from room to room.  Immutable.
class FieldGrid {
 public:
  static constexpr std::uint32_t none = 0xFFFFFFFFu;

  /// cell_m: about the edge of the boxes, which fill the bounds of the scene exactly; larger where that would give more than 16,384.  A
  /// function of scene and cell_m.  Cost: about 0.1 ms for each box that holds geometry, in parallel.
  FieldGrid(const Scene& scene, float cell_m);

  [[nodiscard]] std::size_t size() const { return cells_.size(); }
  [[nodiscard]] glm::vec3 edge_m() const { return edge_m_; }  ///< of a whole box
  [[nodiscard]] float volume_m3(std::uint32_t cell) const { return cells_[cell].volume_m3; }

  /// A segment of a ray inside one cell, metres from its origin.
  struct Crossing {
    std::uint32_t cell;
    float enter_m, leave_m;
  };
  /// Appends the cells that a segment crosses.  A segment is free of geometry between its ends, so it is in one piece of each box; which, a
  /// few short rays decide where there are several.
  void cross(glm::vec3 origin, glm::vec3 direction, float length_m, std::vector<Crossing>& crossings) const;

  struct CellWeight {
    std::uint32_t cell;
    float weight;
  };
  /// The cells round a point that are visible from it, with the weights of trilinear interpolation between the centres of their boxes;
  /// weights add up to 1.  Returns how many; 0 only in an empty scene.  A point outside of the bounds of the scene gets the cells at the
  /// border.  Cost: up to some tens of short rays.
  std::size_t blend(glm::vec3 point, std::array<CellWeight, 8>& weights) const;

  /// Two cells of adjacent boxes that are visible from each other.
  struct Passage {
    std::uint32_t first, second;  ///< first < second
    float openness;               ///< (0, 1]: fraction of lines between points of the two that geometry does not cut
  };
  /// Every passage once, in ascending order of (first, second).  Cost: up to six short rays for each pair of pieces.
  [[nodiscard]] std::vector<Passage> passages() const;

 private:
  static constexpr std::size_t kViews = 6;
  struct Cell {
    float volume_m3 = 0;
    std::uint32_t num_views = 0;
    std::array<glm::vec3, kViews> view{};  ///< points of the piece, spread over it
    /// Bounds of the piece, wide enough that no point of it lies outside.
    glm::vec3 lower{-std::numeric_limits<float>::infinity()}, upper{std::numeric_limits<float>::infinity()};
  };
  struct Box {
    std::uint32_t first = 0, count = 0;  ///< its cells
  };
  [[nodiscard]] std::size_t box_at(const glm::ivec3& index) const {
    return (static_cast<std::size_t>(index.x) * static_cast<std::size_t>(count_.y) + static_cast<std::size_t>(index.y)) *
               static_cast<std::size_t>(count_.z) +
           static_cast<std::size_t>(index.z);
  }
  [[nodiscard]] bool visible_from(const Cell& cell, glm::vec3 point) const;
  [[nodiscard]] float openness(const Cell& a, const Cell& b) const;
  [[nodiscard]] std::uint32_t piece_at(const Box& box, glm::vec3 point) const;
  [[nodiscard]] std::vector<bool> boxes_with_geometry() const;
  [[nodiscard]] std::vector<Cell> pieces_of(const glm::ivec3& index) const;

  const Scene* scene_;
  glm::vec3 origin_{0}, edge_m_{1};
  glm::ivec3 count_{0};
  std::vector<Box> boxes_;
  std::vector<Cell> cells_;
};

}  // namespace earshot
