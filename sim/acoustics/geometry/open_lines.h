// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/geometry/field_boxes.h"
#include "sim/acoustics/geometry/wall_parts.h"
#include "sim/scene/scene.h"

namespace earshot {

/// A bit for each place of the lattice of a box and of kMargin places all round it.
class LatticeBits {
 public:
  static constexpr int kMargin = 2;
  static constexpr int kEdge = FieldBoxes::kPointsPerEdge + 2 * kMargin;

  [[nodiscard]] bool test(const glm::ivec3& at) const { return (row_[row_of(at)] >> at.z & 1) != 0; }
  void set_row(int x, int y, unsigned row) { row_[row_of({x, y, 0})] = static_cast<std::uint16_t>(row); }
  void set(const glm::ivec3& at) { row_[row_of(at)] = static_cast<std::uint16_t>(row_[row_of(at)] | 1 << at.z); }
  friend LatticeBits operator&(const LatticeBits& a, const LatticeBits& b) { return combined(a, b, std::bit_and<>()); }
  friend LatticeBits operator|(const LatticeBits& a, const LatticeBits& b) { return combined(a, b, std::bit_or<>()); }
  /// Moved by so many places along an axis; clear bits follow.
  [[nodiscard]] LatticeBits moved(int axis, int num_lines) const;
  /// Places from which so many in a row along an axis are set.
  [[nodiscard]] LatticeBits eroded(int axis, int count) const;
  /// Set places, and so many less one that follow each along an axis.
  [[nodiscard]] LatticeBits dilated(int axis, int count) const;

 private:
  static std::size_t row_of(const glm::ivec3& at) { return static_cast<std::size_t>(at.x * kEdge + at.y); }
  template <class Operation>
  static LatticeBits combined(const LatticeBits& a, const LatticeBits& b, Operation operation) {
    LatticeBits bits;
    for (std::size_t i = 0; i < a.row_.size(); ++i) bits.row_[i] = static_cast<std::uint16_t>(operation(a.row_[i], b.row_[i]));
    return bits;
  }

  std::array<std::uint16_t, kEdge * kEdge> row_{};  ///< [x][y], a bit for each place along z
};

/// Which lines from each lattice point of a grid to the next one along each axis are open.
class OpenLines {
 public:
  /// Keeps a reference to `boxes`.  Cost: a short ray for each line beside a wall, in parallel.
  OpenLines(const Scene& scene, const FieldBoxes& boxes, const WallParts& walls);

  /// Those along an axis in the box with these indices and round it.
  [[nodiscard]] LatticeBits around(const glm::ivec3& index, int axis) const;

 private:
  const FieldBoxes* boxes_;
  std::vector<std::array<PointBits, 3>> open_;  ///< [box][axis]
};

/// The open lines of a box and round it, and those of them in windows: three by three side by side, with open lines between the neighbours
/// of both ends.  A slit lets a row or two of lines through, and if a wall ends there, the lines on both sides of it are not neighbours.
/// Places count from the first of the margin.
class OpenWindows {
 public:
  /// Cost: 20 us.
  OpenWindows(const OpenLines& lines, const glm::ivec3& index);

  [[nodiscard]] const LatticeBits& lines(int axis) const { return lines_[static_cast<std::size_t>(axis)]; }
  /// Lines along an axis that are part of a window.
  [[nodiscard]] const LatticeBits& along(int axis) const { return windows_[static_cast<std::size_t>(axis)]; }
  /// Those of them that lead to the next box along an axis: bit u * kPointsPerEdge + v for the line at the places u and v along the axes
  /// that follow it.
  [[nodiscard]] std::uint64_t across(int axis) const;

 private:
  [[nodiscard]] LatticeBits find_windows(int axis) const;

  std::array<LatticeBits, 3> lines_, windows_;
};

}  // namespace earshot
