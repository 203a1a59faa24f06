#include "sim/acoustics/geometry/air_cells.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>

#include "sim/base/denormals.h"

namespace earshot {
namespace {

constexpr std::uint8_t kNoPiece = BoxPieces::kNoPiece;

bool is_inside(const Bounds& bounds, glm::vec3 point) {
  return glm::all(glm::greaterThanEqual(point, bounds.lower)) && glm::all(glm::lessThanEqual(point, bounds.upper));
}

}  // namespace

AirCells::AirCells(const Scene& scene, float cell_m) : scene_(&scene) {
  if (scene.mesh().triangles.empty()) return;
  boxes_ = FieldBoxes(scene.bounds(), cell_m);
  box_.resize(boxes_.size());
  mark_boxes_with_geometry();
  find_pieces();
  find_stray_air();
  find_sure_labels();
  for (Box& box : box_) box.is_whole = box.count > 0 && (box.labels == none || (box.count == 1 && box.stray == none));
}

void AirCells::mark_boxes_with_geometry() {
  const TriangleMesh& mesh = scene_->mesh();
  const glm::vec3 slack = 1e-4f * boxes_.edge_m();
  for (const glm::uvec3 corner : mesh.triangles) {
    const glm::vec3 a = mesh.vertices[corner.x], b = mesh.vertices[corner.y], c = mesh.vertices[corner.z];
    const glm::ivec3 lower = boxes_.index_at(glm::min(a, glm::min(b, c)) - slack);
    const glm::ivec3 upper = boxes_.index_at(glm::max(a, glm::max(b, c)) + slack);
    for (int x = lower.x; x <= upper.x; ++x)
      for (int y = lower.y; y <= upper.y; ++y)
        for (int z = lower.z; z <= upper.z; ++z) box_[boxes_.number_of({x, y, z})].holds_geometry = true;
  }
}

void AirCells::find_pieces() {
  std::vector<BoxPieces> pieces(box_.size());
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
    const FlushDenormals flush;
    const glm::ivec3 index = boxes_.index_of(i);
    pieces[i] = box_[i].holds_geometry ? find_box_pieces(*scene_, boxes_, index) : whole_box(boxes_, index);
  });
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const BoxPieces& of_box = pieces[i];
    Box& box = box_[i];
    box.first = static_cast<std::uint32_t>(cells_.size());
    box.count = static_cast<std::uint32_t>(of_box.pieces.size());
    // A sliver on the far side of a wall may be too thin for a piece: what crosses it is not counted for the near side.
    if (box.count > 0 && std::any_of(of_box.label.begin(), of_box.label.end(), [](std::uint8_t label) { return label != 0; })) {
      box.labels = static_cast<std::uint32_t>(labels_.size());
      labels_.insert(labels_.end(), of_box.label.begin(), of_box.label.end());
    }
    cells_.insert(cells_.end(), of_box.pieces.begin(), of_box.pieces.end());
  }
}

/// Points of no piece that see air of a neighbouring box lie in a layer too thin for a piece, on the far side of a wall: what crosses it
/// must not count for the near side.
void AirCells::find_stray_air() {
  std::vector<std::uint8_t> found(labels_.size(), 0);
  tbb::parallel_for(std::size_t{0}, box_.size(), [&](std::size_t box) {
    const FlushDenormals flush;
    const Box& here = box_[box];
    if (here.labels == none) return;
    const glm::ivec3 index = boxes_.index_of(box);
    for (int i = 0; i < FieldBoxes::kPoints; ++i) {
      if (labels_[here.labels + i] != kNoPiece) continue;
      const glm::ivec3 at = FieldBoxes::lattice_place(i);
      for (int axis = 0; axis < 3; ++axis) {
        if (at[axis] != 0 && at[axis] + 1 != FieldBoxes::kPointsPerEdge) continue;
        glm::ivec3 next = index, other = at;
        next[axis] += at[axis] == 0 ? -1 : 1;
        other[axis] = FieldBoxes::kPointsPerEdge - 1 - at[axis];
        if (next[axis] < 0 || next[axis] >= boxes_.count()[axis]) continue;
        const Box& there = box_[boxes_.number_of(next)];
        const bool is_air =
            there.count > 0 && (there.labels == none || labels_[there.labels + FieldBoxes::lattice_number(other)] != kNoPiece);
        if (is_air && !scene_->rays().occluded(boxes_.lattice_point(index, at), boxes_.lattice_point(next, other)))
          found[here.labels + i] = 1;
      }
    }
  });
  for (std::size_t i = 0; i < box_.size(); ++i) {
    Box& box = box_[i];
    for (int k = 0; box.labels != none && k < FieldBoxes::kPoints; ++k) {
      if (!found[box.labels + k]) continue;
      labels_[box.labels + k] = kStrayAir;
      const glm::vec3 point = boxes_.lattice_point(boxes_.index_of(i), FieldBoxes::lattice_place(k));
      if (box.stray == none) {
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
  const Box& of = box_[box];
  if (of.labels == none) return of.count > 0 ? of.first : none;
  const std::uint8_t label = labels_[of.labels + static_cast<std::uint32_t>(number)];
  return label < kStrayAir ? of.first + label : none;
}

bool AirCells::visible_from(std::uint32_t cell, glm::vec3 point) const {
  const AirPiece& piece = cells_[cell];
  for (std::uint32_t i = 0; i < piece.num_views; ++i)
    if (!scene_->rays().occluded(point, piece.view[i])) return true;
  return false;
}

/// Around a point of a piece whose neighbours belong to it too, or to none, no wall is near.
void AirCells::find_sure_labels() {
  sure_ = labels_;
  for (const Box& box : box_) {
    if (box.labels == none) continue;
    const std::uint8_t* label = &labels_[box.labels];
    for (int i = 0; i < FieldBoxes::kPoints; ++i) {
      const glm::ivec3 at = FieldBoxes::lattice_place(i);
      const auto may_be = [&](int other) { return label[other] == label[i] || label[other] == kNoPiece; };
      bool same = true;
      for (int axis = 0; axis < 3; ++axis) {
        const int stride = FieldBoxes::kStrides[static_cast<std::size_t>(axis)];
        same = same && (at[axis] == 0 || may_be(i - stride));
        same = same && (at[axis] + 1 == FieldBoxes::kPointsPerEdge || may_be(i + stride));
      }
      if (!same) sure_[box.labels + static_cast<std::uint32_t>(i)] = kNoPiece;
    }
  }
}

bool AirCells::may_be_stray(std::size_t box, glm::vec3 point) const {
  return box_[box].stray != none && is_inside(stray_[box_[box].stray], point);
}

/// The cell of a box that holds a point, as far as that is known without a ray; none where it is not.
std::uint32_t AirCells::sure_cell_at(const Box& of, const glm::ivec3& index, glm::vec3 point) const {
  if (of.is_whole) return of.first;
  // Mostly the points all round it belong to one piece, or bounds tell, as a straight wall leaves its two sides apart.
  const auto number = static_cast<std::uint32_t>(FieldBoxes::lattice_number(boxes_.lattice_place_in(index, point)));
  if (const std::uint8_t label = sure_[of.labels + number]; label < kStrayAir) return of.first + label;
  if (of.stray != none && is_inside(stray_[of.stray], point)) return none;
  std::uint32_t only = none, candidates = 0;
  for (std::uint32_t cell = of.first; cell < of.first + of.count; ++cell)
    if (is_inside({cells_[cell].lower, cells_[cell].upper}, point)) only = cell, ++candidates;
  return candidates == 1 ? only : none;
}

std::uint32_t AirCells::cell_at(std::size_t box, glm::vec3 point) const {
  if (box_[box].count == 0) return none;
  const std::uint32_t sure = sure_cell_at(box_[box], boxes_.index_of(box), point);
  return sure != none ? sure : cell_near_walls(box, point);
}

std::uint32_t AirCells::sure_cell_among_pieces(const Box& of, const glm::ivec3& index, glm::vec3 enter, glm::vec3 leave) const {
  if (of.count == 0) return none;
  for (const float part : {0.5f, 0.25f, 0.75f})
    if (const std::uint32_t sure = sure_cell_at(of, index, enter + part * (leave - enter)); sure != none) return sure;
  return none;
}

/// Near a wall: the cell of the nearest lattice points that are visible.  Lines to them are short, so seldom through a slit.
std::uint32_t AirCells::cell_near_walls(std::size_t box, glm::vec3 point) const {
  const Box& of = box_[box];
  const glm::ivec3 index = boxes_.index_of(box), at = boxes_.lattice_place_in(index, point);
  const std::uint8_t* label = &labels_[of.labels];
  const auto sees = [&](const glm::ivec3& other) {
    return label[FieldBoxes::lattice_number(other)] < kStrayAir && !scene_->rays().occluded(point, boxes_.lattice_point(index, other));
  };
  if (sees(at)) return of.first + label[FieldBoxes::lattice_number(at)];
  // Those beside it by a face, an edge, a corner.
  for (int distance = 1; distance <= 3; ++distance)
    for (int step = 0; step < 27; ++step) {
      const glm::ivec3 by(step / 9 - 1, step / 3 % 3 - 1, step % 3 - 1), other = at + by;
      if (std::abs(by.x) + std::abs(by.y) + std::abs(by.z) != distance) continue;
      if (glm::clamp(other, 0, FieldBoxes::kPointsPerEdge - 1) == other && sees(other))
        return of.first + label[FieldBoxes::lattice_number(other)];
    }
  return none;
}

}  // namespace earshot
