// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/cell_passages.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <utility>

namespace earshot {
namespace {

/// Cells with a smaller passage between them are apart: a slit does not join the sides of a wall.
constexpr float kMinOpenness = 0.25f;

/// Passages through the face between a box and the next one along an axis.
void find_passages_between(const AirCells& cells, const glm::ivec3& index, int axis, std::vector<CellPassage>& found) {
  glm::ivec3 next = index;
  ++next[axis];
  const FieldBoxes& boxes = cells.boxes();
  const std::size_t box_here = boxes.number_of(index), box_there = boxes.number_of(next);
  const AirCells::Box &first_box = cells.box(box_here), &second_box = cells.box(box_there);
  const std::uint64_t open_lines = cells.open_across(box_here, axis);
  if (first_box.labels == AirCells::no_index && second_box.labels == AirCells::no_index && first_box.count == 1 && second_box.count == 1 &&
      ~open_lines == 0) {
    found.push_back({first_box.first, second_box.first, 1.f});
    return;
  }
  // The points beside the face, of each piece, and the lines across it that are open.
  std::vector<int> points_here(first_box.count, 0), points_there(second_box.count, 0), open(first_box.count * second_box.count, 0);
  for (int i = 0; i < FieldBoxes::kPointsPerEdge * FieldBoxes::kPointsPerEdge; ++i) {
    glm::ivec3 at(0), other(0);
    at[axis] = FieldBoxes::kPointsPerEdge - 1;
    at[(axis + 1) % 3] = other[(axis + 1) % 3] = i / FieldBoxes::kPointsPerEdge;
    at[(axis + 2) % 3] = other[(axis + 2) % 3] = i % FieldBoxes::kPointsPerEdge;
    const int number_here = FieldBoxes::lattice_number(at), number_there = FieldBoxes::lattice_number(other);
    const std::uint32_t a = cells.cell_of_lattice(box_here, number_here), b = cells.cell_of_lattice(box_there, number_there);
    if (a != AirCells::no_index) ++points_here[a - first_box.first];
    if (b != AirCells::no_index) ++points_there[b - second_box.first];
    if (a != AirCells::no_index && b != AirCells::no_index && (open_lines >> i & 1) != 0)
      ++open[(a - first_box.first) * second_box.count + b - second_box.first];
  }
  for (std::uint32_t a = 0; a < first_box.count; ++a)
    for (std::uint32_t b = 0; b < second_box.count; ++b) {
      const int lines = open[a * second_box.count + b], most = std::min(points_here[a], points_there[b]);
      const float openness = static_cast<float>(lines) / static_cast<float>(std::max(most, 1));
      if (openness >= kMinOpenness) found.push_back({first_box.first + a, second_box.first + b, openness});
    }
}

}  // namespace

CellPassages::CellPassages(const AirCells& cells) {
  const FieldBoxes& boxes = cells.boxes();
  std::vector<std::vector<CellPassage>> of_box(boxes.size());
  tbb::parallel_for(std::size_t{0}, boxes.size(), [&](std::size_t i) {
    const glm::ivec3 index = boxes.index_of(i);
    for (int axis = 0; axis < 3; ++axis) {
      glm::ivec3 next = index;
      if (++next[axis] < boxes.count()[axis]) find_passages_between(cells, index, axis, of_box[i]);
    }
  });
  for (const std::vector<CellPassage>& box_passages : of_box) passages_.insert(passages_.end(), box_passages.begin(), box_passages.end());
  std::sort(passages_.begin(), passages_.end(),
            [](const CellPassage& a, const CellPassage& b) { return std::pair(a.first, a.second) < std::pair(b.first, b.second); });
  std::vector<std::vector<std::uint32_t>> neighbours(cells.size());
  for (const CellPassage& p : passages_) {
    neighbours[p.first].push_back(p.second);
    neighbours[p.second].push_back(p.first);
  }
  neighbours_begin_.push_back(0);
  for (std::vector<std::uint32_t>& of_cell : neighbours) {
    std::sort(of_cell.begin(), of_cell.end());
    neighbours_.insert(neighbours_.end(), of_cell.begin(), of_cell.end());
    neighbours_begin_.push_back(static_cast<std::uint32_t>(neighbours_.size()));
  }
}

bool CellPassages::joined(std::uint32_t cell, std::uint32_t other) const {
  return std::binary_search(neighbours_.begin() + neighbours_begin_[cell], neighbours_.begin() + neighbours_begin_[cell + 1], other);
}

}  // namespace earshot
