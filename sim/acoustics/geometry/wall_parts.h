// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/geometry/field_boxes.h"
#include "sim/base/memory_bytes.h"
#include "sim/scene/mesh/triangle_mesh.h"

namespace earshot {

/// Where triangles lie in the boxes of a grid, found exactly (Akenine-Moller 2001).  A part of a box lies round each of its lattice points,
/// an eighth of its edge wide.  A part into which no triangle reaches sees its point from everywhere; two parts side by side that none
/// touches see all of each other.  Immutable; safe from any thread.
class WallParts {
 public:
  WallParts() = default;  ///< of no box
  /// Cost: 20 ns for each box in the bounds of a triangle, and for each part of the boxes that it touches.
  WallParts(const TriangleMesh& mesh, const FieldBoxes& boxes);

  /// Does a triangle touch the box?
  [[nodiscard]] bool touch_box(std::size_t box) const { return of_box_[box] != kNone; }
  /// Does a triangle reach into the box, further than its faces?
  [[nodiscard]] bool reach_into_box(std::size_t box) const { return touch_box(box) && parts_[of_box_[box]].reaches_into_box; }
  /// Does a triangle touch the part round the lattice point with this number?
  [[nodiscard]] bool touch_part(std::size_t box, int number) const { return touch_box(box) && parts_[of_box_[box]].touch.test(number); }
  /// Does a triangle reach into it, further than its faces?
  [[nodiscard]] bool reach_into_part(std::size_t box, int number) const {
    return touch_box(box) && parts_[of_box_[box]].reach.test(number);
  }
  [[nodiscard]] std::size_t bytes() const { return bytes_of(of_box_) + bytes_of(parts_); }

 private:
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  struct Parts {
    PointBits touch, reach;
    bool reaches_into_box = false;
  };
  void mark(const std::array<glm::vec3, 3>& corners, const FieldBoxes& boxes);

  std::vector<std::uint32_t> of_box_;  ///< index in parts_, or kNone
  std::vector<Parts> parts_;
};

}  // namespace earshot
