// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/open_lines.h"

#include <tbb/parallel_for.h>

#include "sim/base/denormals.h"

namespace earshot {
namespace {

constexpr int kWindowLines = LatticeBits::kMargin + 1;  // along each edge of a window
constexpr int kEdge = LatticeBits::kEdge, kMargin = LatticeBits::kMargin;

}  // namespace

LatticeBits LatticeBits::moved(int axis, int num_lines) const {
  LatticeBits bits;
  for (int x = 0; x < kEdge; ++x)
    for (int y = 0; y < kEdge; ++y) {
      const int from_x = x - (axis == 0 ? num_lines : 0), from_y = y - (axis == 1 ? num_lines : 0);
      if (from_x < 0 || from_x >= kEdge || from_y < 0 || from_y >= kEdge) continue;
      const unsigned row = row_[row_of({from_x, from_y, 0})];
      bits.row_[row_of({x, y, 0})] = static_cast<std::uint16_t>(axis != 2       ? row
                                                                : num_lines < 0 ? row >> -num_lines
                                                                                : row << num_lines & ((1u << kEdge) - 1));
    }
  return bits;
}

LatticeBits LatticeBits::eroded(int axis, int count) const {
  LatticeBits bits = *this;
  for (int num_lines = 1; num_lines < count; ++num_lines) bits = bits & moved(axis, -num_lines);
  return bits;
}

LatticeBits LatticeBits::dilated(int axis, int count) const {
  LatticeBits bits = *this;
  for (int num_lines = 1; num_lines < count; ++num_lines) bits = bits | moved(axis, num_lines);
  return bits;
}

OpenLines::OpenLines(const Scene& scene, const FieldBoxes& boxes, const WallParts& walls) : boxes_(&boxes), open_(boxes.size()) {
  tbb::parallel_for(std::size_t{0}, open_.size(), [&](std::size_t box) {
    const FlushDenormals flush;
    const glm::ivec3 index = boxes.index_of(box);
    for (int axis = 0; axis < 3; ++axis) {
      glm::ivec3 next_index = index;
      const bool has_next = ++next_index[axis] < boxes.count()[axis];
      const std::size_t next_box = has_next ? boxes.number_of(next_index) : box;
      for (int number = 0; number < FieldBoxes::kPoints; ++number) {
        const glm::ivec3 at = FieldBoxes::lattice_place(number);
        glm::ivec3 next = at;
        const bool crosses = ++next[axis] == FieldBoxes::kPointsPerEdge;
        if (crosses && !has_next) continue;
        if (crosses) next[axis] = 0;
        // Two parts side by side make a box: geometry outside of both does not cut the line.
        const bool may_be_cut =
            walls.touch_part(box, number) || walls.touch_part(crosses ? next_box : box, FieldBoxes::lattice_number(next));
        if (!may_be_cut || !scene.rays().occluded(boxes.lattice_point(index, at), boxes.lattice_point(crosses ? next_index : index, next)))
          open_[box][static_cast<std::size_t>(axis)].set(number);
      }
    }
  });
}

LatticeBits OpenLines::around(const glm::ivec3& index, int axis) const {
  constexpr int kPoints = FieldBoxes::kPointsPerEdge;
  const glm::ivec3 first = index * kPoints - kMargin, count = boxes_->count() * kPoints;
  const auto row_of = [&](const glm::ivec3& box, int x, int y) {
    return box.z < 0 || box.z >= boxes_->count().z ? 0u : open_[boxes_->number_of(box)][static_cast<std::size_t>(axis)].row(x, y);
  };
  LatticeBits bits;
  for (int x = 0; x < kEdge; ++x)
    for (int y = 0; y < kEdge; ++y) {
      const int at_x = first.x + x, at_y = first.y + y;
      if (at_x < 0 || at_x >= count.x || at_y < 0 || at_y >= count.y) continue;
      const glm::ivec3 box(at_x / kPoints, at_y / kPoints, index.z);
      const unsigned lower_row = row_of(box - glm::ivec3(0, 0, 1), at_x % kPoints, at_y % kPoints);
      const unsigned middle_row = row_of(box, at_x % kPoints, at_y % kPoints);
      const unsigned upper_row = row_of(box + glm::ivec3(0, 0, 1), at_x % kPoints, at_y % kPoints);
      bits.set_row(x, y,
                   lower_row >> (kPoints - kMargin) | middle_row << kMargin | (upper_row & ((1u << kMargin) - 1)) << (kMargin + kPoints));
    }
  return bits;
}

OpenWindows::OpenWindows(const OpenLines& lines, const glm::ivec3& index) {
  for (int axis = 0; axis < 3; ++axis) lines_[static_cast<std::size_t>(axis)] = lines.around(index, axis);
  for (int axis = 0; axis < 3; ++axis) windows_[static_cast<std::size_t>(axis)] = find_windows(axis);
}

LatticeBits OpenWindows::find_windows(int axis) const {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const auto at_both_ends = [&](int side) { return lines(side) & lines(side).moved(axis, -1); };
  const LatticeBits windows = lines(axis).eroded(u, kWindowLines).eroded(v, kWindowLines) &
                              at_both_ends(u).eroded(u, kWindowLines - 1).eroded(v, kWindowLines) &
                              at_both_ends(v).eroded(u, kWindowLines).eroded(v, kWindowLines - 1);
  return windows.dilated(u, kWindowLines).dilated(v, kWindowLines);
}

std::uint64_t OpenWindows::across(int axis) const {
  std::uint64_t bits = 0;
  glm::ivec3 at(0);
  at[axis] = kMargin + FieldBoxes::kPointsPerEdge - 1;
  for (int i = 0; i < FieldBoxes::kPointsPerEdge * FieldBoxes::kPointsPerEdge; ++i) {
    at[(axis + 1) % 3] = kMargin + i / FieldBoxes::kPointsPerEdge;
    at[(axis + 2) % 3] = kMargin + i % FieldBoxes::kPointsPerEdge;
    bits |= std::uint64_t{along(axis).test(at)} << i;
  }
  return bits;
}

}  // namespace earshot
