// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/air_cells.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>

#include "sim/base/denormals.h"

namespace earshot {
namespace {

constexpr std::uint8_t kNoPiece = BoxPieces::kNoPiece;

bool is_inside(const Bounds& bounds, glm::vec3 point) {
  return glm::all(glm::greaterThanEqual(point, bounds.lower)) && glm::all(glm::lessThanEqual(point, bounds.upper));
}

/// Does a wall touch the box with these indices, or the next one along an axis?
bool is_beside_wall(const FieldBoxes& boxes, const WallParts& walls, const glm::ivec3& index) {
  bool is_beside = walls.touch_box(boxes.number_of(index));
  for (int axis = 0; axis < 3; ++axis) {
    glm::ivec3 next = index;
    if (++next[axis] < boxes.count()[axis]) is_beside = is_beside || walls.touch_box(boxes.number_of(next));
  }
  return is_beside;
}

}  // namespace

AirCells::AirCells(const Scene& scene, float cell_m) : scene_(&scene) {
  if (scene.mesh().triangles.empty()) return;
  boxes_ = FieldBoxes(scene.bounds(), cell_m);
  box_.resize(boxes_.size());
  const WallParts walls(scene.mesh(), boxes_);
  find_pieces(walls);
  find_stray_air();
  find_part_labels(walls);
}

void AirCells::find_pieces(const WallParts& walls) {
  const OpenLines lines(*scene_, boxes_, walls);
  std::vector<BoxPieces> pieces(box_.size());
  open_across_.assign(box_.size(), {~std::uint64_t{0}, ~std::uint64_t{0}, ~std::uint64_t{0}});
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
    const FlushDenormals flush;
    const glm::ivec3 index = boxes_.index_of(i);
    pieces[i] = whole_box(boxes_, index);
    if (!is_beside_wall(boxes_, walls, index)) return;
    const OpenWindows windows(lines, index);
    for (int axis = 0; axis < 3; ++axis) open_across_[i][static_cast<std::size_t>(axis)] = windows.across(axis);
    if (walls.reach_into_box(i)) pieces[i] = find_box_pieces(*scene_, boxes_, windows, index);
  });
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const BoxPieces& of_box = pieces[i];
    Box& box = box_[i];
    box.is_whole = !walls.reach_into_box(i);
    box.first = static_cast<std::uint32_t>(cells_.size());
    box.count = static_cast<std::uint32_t>(of_box.pieces.size());
    // A sliver on the far side of a wall may be too thin for a piece: rays through it do not count for the near side.
    if (box.count > 0 && std::any_of(of_box.label.begin(), of_box.label.end(), [](std::uint8_t label) { return label != 0; })) {
      box.labels = static_cast<std::uint32_t>(labels_.size());
      labels_.insert(labels_.end(), of_box.label.begin(), of_box.label.end());
    }
    cells_.insert(cells_.end(), of_box.pieces.begin(), of_box.pieces.end());
  }
}

/// Points of no piece that see air of a neighbouring box lie in a layer too thin for a piece, on the far side of a wall: rays through it
/// must not count for the near side.
void AirCells::find_stray_air() {
  std::vector<std::uint8_t> found(labels_.size(), 0);
  tbb::parallel_for(std::size_t{0}, box_.size(), [&](std::size_t box) {
    const FlushDenormals flush;
    const Box& box_cells = box_[box];
    if (box_cells.labels == no_index) return;
    const glm::ivec3 index = boxes_.index_of(box);
    for (int i = 0; i < FieldBoxes::kPoints; ++i) {
      if (labels_[box_cells.labels + i] != kNoPiece) continue;
      const glm::ivec3 at = FieldBoxes::lattice_place(i);
      for (int axis = 0; axis < 3; ++axis) {
        if (at[axis] != 0 && at[axis] + 1 != FieldBoxes::kPointsPerEdge) continue;
        glm::ivec3 next = index, other = at;
        next[axis] += at[axis] == 0 ? -1 : 1;
        other[axis] = FieldBoxes::kPointsPerEdge - 1 - at[axis];
        if (next[axis] < 0 || next[axis] >= boxes_.count()[axis]) continue;
        const Box& next_cells = box_[boxes_.number_of(next)];
        const bool is_air = next_cells.count > 0 &&
                            (next_cells.labels == no_index || labels_[next_cells.labels + FieldBoxes::lattice_number(other)] != kNoPiece);
        if (is_air && !scene_->rays().occluded(boxes_.lattice_point(index, at), boxes_.lattice_point(next, other)))
          found[box_cells.labels + i] = 1;
      }
    }
  });
  for (std::size_t i = 0; i < box_.size(); ++i) {
    Box& box = box_[i];
    for (int k = 0; box.labels != no_index && k < FieldBoxes::kPoints; ++k) {
      if (!found[box.labels + k]) continue;
      labels_[box.labels + k] = kStrayAir;
      const glm::vec3 point = boxes_.lattice_point(boxes_.index_of(i), FieldBoxes::lattice_place(k));
      if (box.stray == no_index) {
        box.stray = static_cast<std::uint32_t>(stray_.size());
        stray_.push_back({point, point});
      }
      Bounds& bounds = stray_[box.stray];
      bounds.lower = glm::min(bounds.lower, point - 0.5f / FieldBoxes::kPointsPerEdge * boxes_.edge_m());
      bounds.upper = glm::max(bounds.upper, point + 0.5f / FieldBoxes::kPointsPerEdge * boxes_.edge_m());
    }
  }
}

std::uint32_t AirCells::cell_of_lattice(std::size_t box, int number) const {
  const Box& box_cells = box_[box];
  if (box_cells.labels == no_index) return box_cells.count > 0 ? box_cells.first : no_index;
  const std::uint8_t label = labels_[box_cells.labels + static_cast<std::uint32_t>(number)];
  return label < kStrayAir ? box_cells.first + label : no_index;
}

bool AirCells::visible_from(std::uint32_t cell, glm::vec3 point) const {
  const AirPiece& piece = cells_[cell];
  for (std::uint32_t i = 0; i < piece.num_views; ++i)
    if (!scene_->rays().occluded(point, piece.view[i])) return true;
  return false;
}

bool AirCells::may_be_stray(std::size_t box, glm::vec3 point) const {
  return box_[box].stray != no_index && is_inside(stray_[box_[box].stray], point);
}

/// A part into which no wall reaches is of the cell of its point.
void AirCells::find_part_labels(const WallParts& walls) {
  for (std::size_t i = 0; i < box_.size(); ++i) {
    Box& box = box_[i];
    if (box.is_whole) continue;
    box.part_labels = static_cast<std::uint32_t>(part_labels_.size());
    for (int number = 0; number < FieldBoxes::kPoints; ++number) {
      const std::uint8_t label = box.labels == no_index ? std::uint8_t{0} : labels_[box.labels + static_cast<std::uint32_t>(number)];
      part_labels_.push_back(walls.reach_into_part(i, number) ? kBesideWall : label);
    }
  }
}

/// The cell of a box that holds a point, or outside_cells, as far as known without a ray; otherwise no_index.
std::uint32_t AirCells::known_cell_at(const Box& box, const glm::ivec3& index, glm::vec3 point) const {
  if (box.is_whole) return box.first;
  const std::uint8_t label =
      part_labels_[box.part_labels + static_cast<std::uint32_t>(FieldBoxes::lattice_number(boxes_.lattice_place_in(index, point)))];
  if (label == kBesideWall) return no_index;
  return label < kStrayAir ? box.first + label : outside_cells;
}

std::uint32_t AirCells::cell_at(std::size_t box, glm::vec3 point) const {
  if (box_[box].count == 0) return no_index;
  const std::uint32_t known = known_cell_at(box_[box], boxes_.index_of(box), point);
  return known == outside_cells ? no_index : known != no_index ? known : cell_near_walls(box, point);
}

std::array<std::uint32_t, 2> AirCells::known_cells_beside_walls(const Box& box, const glm::ivec3& index, glm::vec3 enter,
                                                                glm::vec3 leave) const {
  if (box.count == 0) return {no_index, no_index};
  const auto at = [&](float part) { return known_cell_at(box, index, enter + part * (leave - enter)); };
  std::array<std::uint32_t, 2> halves{at(0.25f), at(0.75f)};
  if (halves[0] == no_index) halves[0] = halves[1] == no_index ? at(0.5f) : halves[1];
  if (halves[1] == no_index) halves[1] = halves[0];
  return halves;
}

/// Near a wall: the cell of most of the lattice points all round that are visible.
std::uint32_t AirCells::cell_near_walls(std::size_t box, glm::vec3 point) const {
  const glm::ivec3 index = boxes_.index_of(box), at = boxes_.lattice_place_in(index, point), last(FieldBoxes::kPointsPerEdge - 1);
  VisibleMajority majority;
  for_each_place(glm::max(at - 1, 0), glm::min(at + 1, last), [&](const glm::ivec3& place) {
    const std::uint32_t cell = cell_of_lattice(box, FieldBoxes::lattice_number(place));
    if (cell != no_index) majority.add(cell, !scene_->rays().occluded(point, boxes_.lattice_point(index, place)));
  });
  return majority.group();
}

}  // namespace earshot
