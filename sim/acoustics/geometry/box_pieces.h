// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/geometry/field_boxes.h"
#include "sim/acoustics/geometry/open_lines.h"
#include "sim/scene/scene.h"

namespace earshot {

/// Finds the group of lattice points that a place beside a wall belongs to: the group with most visible points around the place.  Through a
/// slit only a few points beyond the wall are visible, so at least a quarter of the group's points around the place must be visible.
class VisibleMajority {
 public:
  static constexpr std::uint32_t no_group = 0xFFFFFFFFu;

  /// A point round the place; at most 27.
  void add(std::uint32_t group, bool is_visible) {
    std::size_t i = 0;
    while (i < count_ && group_[i] != group) ++i;
    if (i == count_) group_[count_++] = group;
    ++points_[i];
    visible_[i] += is_visible ? 1 : 0;
  }
  /// The first of several; no_group if no group has enough visible points.
  [[nodiscard]] std::uint32_t group() const {
    std::size_t best = 0;
    for (std::size_t i = 1; i < count_; ++i)
      if (visible_[i] > visible_[best]) best = i;
    return count_ > 0 && visible_[best] > 0 && 4 * visible_[best] >= points_[best] ? group_[best] : no_group;
  }

 private:
  std::array<std::uint32_t, 27> group_;
  std::array<int, 27> points_{}, visible_{};
  std::size_t count_ = 0;
};

/// A piece of the air of a box.
struct AirPiece {
  static constexpr std::size_t kViews = 6;
  float volume_m3 = 0;
  std::uint32_t num_views = 0;
  std::array<glm::vec3, kViews> view{};  ///< points of the piece, spread over it
};

/// The pieces of a box, largest first, and of which of them its lattice points are.
struct BoxPieces {
  /// Label of points that belong to no piece: inside of something, or in a thin layer of air beside a wall at the border of the box.
  static constexpr std::uint8_t kNoPiece = 0xFF;
  std::vector<AirPiece> pieces;
  std::vector<std::uint8_t> label;  ///< [FieldBoxes::kPoints] index in `pieces`, or kNoPiece; empty: all points are of the only piece
};

/// A box into which no wall reaches: one piece.
BoxPieces whole_box(const FieldBoxes& boxes, const glm::ivec3& index);

/// Groups of points of a box that see each other, from neighbour to neighbour, through more than a slit: three by three lines side by side,
/// which may lie in the boxes round it, as air beside a wall near the border goes on there.  Points between walls nearer than that go to
/// the group that they see most of.  Pieces of fewer than 12 of the 512 points are left out: gaps behind furniture or the inside of walls,
/// too small to know their volume.
/// Cost: about 30 us.
BoxPieces find_box_pieces(const Scene& scene, const FieldBoxes& boxes, const OpenWindows& windows, const glm::ivec3& index);

}  // namespace earshot
