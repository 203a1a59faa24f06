// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/base/memory_bytes.h"
#include "sim/nav/navmesh.h"

namespace earshot {

/// The walkable surface of a navmesh's main island seen from above, in square cells of NavmeshConfig::cell_size_m: the source of all maps
/// of a scene.  A cell has one height for each storey at its middle.  Immutable, safe from any thread; 8 bytes per cell; 2 to 30 ms.
class WalkableMap {
 public:
  /// Cells at most; a larger surface gets larger cells.
  static constexpr std::size_t kMaxCells = 16'000'000;
  explicit WalkableMap(const Navmesh& navmesh);

  /// Whether the middle of the cell around (x, z) is walkable within kStoreyM of this height.
  [[nodiscard]] bool walkable(float x, float z, float height) const {
    const float column = (x - low_.x) * per_m_, row = (z - low_.y) * per_m_;
    if (!(column >= 0 && row >= 0 && column < columns_ && row < rows_)) return false;
    const std::size_t cell = static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
    for (std::uint32_t i = first_[cell]; i < first_[cell + 1]; ++i)
      if (std::fabs(heights_[i] - height) <= kStoreyM) return true;
    return false;
  }
  /// A storey's floor differs from its mean by less: the half metre by which habitat-sim slices its maps (PathFinder::getTopDownView).
  static constexpr float kStoreyM = 0.5f;

  [[nodiscard]] glm::vec2 low() const { return low_; }  ///< corner of the cells with the least x and z, metres
  [[nodiscard]] glm::vec2 high() const { return low_ + glm::vec2(columns_, rows_) / per_m_; }
  [[nodiscard]] float cell_m() const { return 1.f / per_m_; }
  [[nodiscard]] std::size_t bytes() const { return bytes_of(first_) + bytes_of(heights_); }

 private:
  glm::vec2 low_{0};
  float per_m_ = 1, columns_ = 0, rows_ = 0;
  std::vector<std::uint32_t> first_;  ///< of each cell in `heights_`; one more at the end
  std::vector<float> heights_;
};

}  // namespace earshot
