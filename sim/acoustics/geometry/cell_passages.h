// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/geometry/air_cells.h"
#include "sim/base/memory_bytes.h"

namespace earshot {

/// Two cells of adjacent boxes with more than a slit between them.
struct CellPassage {
  std::uint32_t first, second;  ///< first < second
  float openness;               ///< [0.25, 1]: fraction of short lines across their common face that are open (OpenWindows)
};

/// How the cells of a scene are joined.  Immutable; safe from any thread.
class CellPassages {
 public:
  /// Cost: about 0.5 us for each face of a box that a wall cuts, in parallel.
  explicit CellPassages(const AirCells& cells);

  /// Every passage once, in ascending order of (first, second).
  [[nodiscard]] std::span<const CellPassage> all() const { return passages_; }
  /// Does a passage join two cells?  O(log of the cell's passages).
  [[nodiscard]] bool joined(std::uint32_t cell, std::uint32_t other) const;
  [[nodiscard]] std::size_t bytes() const { return bytes_of(passages_) + bytes_of(neighbours_begin_) + bytes_of(neighbours_); }

 private:
  std::vector<CellPassage> passages_;
  std::vector<std::uint32_t> neighbours_begin_;  ///< [cells + 1], in neighbours_
  std::vector<std::uint32_t> neighbours_;        ///< cells that passages join to each, ascending
};

}  // namespace earshot
