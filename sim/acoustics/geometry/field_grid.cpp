#include "sim/acoustics/geometry/field_grid.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>
#include <iterator>
#include <numeric>
#include <utility>

#include "sim/base/denormals.h"

namespace earshot {
namespace {

constexpr float kMaxBoxes = 16'384.f;
/// Points along each edge of a box that find its pieces and their volumes: jittered, so a wall that cuts a box is off by about 1 % of it.
constexpr int kPointsPerEdge = 8;
constexpr int kPoints = kPointsPerEdge * kPointsPerEdge * kPointsPerEdge;
/// Pieces of fewer points are gaps behind furniture or the inside of walls: too small to know their volume.
constexpr std::size_t kLeastPoints = 12;
/// Labels of points that belong to no piece: inside of something, or in a thin layer of air beside a wall at the border of the box.
constexpr std::uint8_t kNoPiece = 0xFF, kStrayAir = 0xFE;

/// Cells with a smaller passage between them are apart: a slit does not join the sides of a wall.
constexpr float kLeastOpenness = 0.25f;

constexpr int n = kPointsPerEdge;
constexpr std::array<int, 3> kStrides{n * n, n, 1};
int number_of(const glm::ivec3& at) { return (at.x * n + at.y) * n + at.z; }
glm::ivec3 point_at(int number) { return {number / (n * n), number / n % n, number % n}; }

/// Sets that grow together.
class Groups {
 public:
  Groups() { std::iota(parent_.begin(), parent_.end(), 0); }
  int find(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int a, int b) {
    a = find(a), b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::array<int, kPoints> parent_{};
};

}  // namespace

FieldGrid::FieldGrid(const Scene& scene, float cell_m) : scene_(&scene) {
  if (scene.mesh().triangles.empty()) return;
  const glm::vec3 size = glm::max(scene.bounds().upper - scene.bounds().lower, glm::vec3(1e-3f));
  for (float edge = cell_m;; edge *= 1.1f) {
    const glm::vec3 boxes = glm::max(glm::round(size / edge), glm::vec3(1.f));
    if (!(boxes.x * boxes.y * boxes.z <= kMaxBoxes)) continue;
    count_ = glm::ivec3(boxes);
    break;
  }
  origin_ = scene.bounds().lower;
  edge_m_ = size / glm::vec3(count_);

  const std::vector<bool> holds_geometry = boxes_with_geometry();
  std::vector<Pieces> pieces(holds_geometry.size());
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
    const FlushDenormals flush;
    const glm::ivec3 index = index_of(i);
    if (holds_geometry[i]) {
      pieces[i] = pieces_of(index);
    } else {
      Cell whole{.volume_m3 = edge_m_.x * edge_m_.y * edge_m_.z, .num_views = 1};
      whole.view[0] = origin_ + (glm::vec3(index) + 0.5f) * edge_m_;
      pieces[i].cells.push_back(whole);
    }
  });
  for (const Pieces& of_box : pieces) {
    Box box{.first = static_cast<std::uint32_t>(cells_.size()), .count = static_cast<std::uint32_t>(of_box.cells.size())};
    // A sliver on the far side of a wall may be too thin for a piece: what crosses it is not counted for the near side.
    if (box.count > 0 && std::any_of(of_box.label.begin(), of_box.label.end(), [](std::uint8_t label) { return label != 0; })) {
      box.labels = static_cast<std::uint32_t>(labels_.size());
      labels_.insert(labels_.end(), of_box.label.begin(), of_box.label.end());
    }
    boxes_.push_back(box);
    cells_.insert(cells_.end(), of_box.cells.begin(), of_box.cells.end());
  }
  find_stray_air();
  find_passages(holds_geometry);
  // Where all air is of one piece no point needs a label.
  for (Box& box : boxes_)
    if (box.count == 1 && box.stray == none) box.labels = none;
}

/// Boxes that the bounds of some triangle touch.
std::vector<bool> FieldGrid::boxes_with_geometry() const {
  const TriangleMesh& mesh = scene_->mesh();
  std::vector<bool> holds(static_cast<std::size_t>(count_.x) * static_cast<std::size_t>(count_.y) * static_cast<std::size_t>(count_.z),
                          false);
  const glm::vec3 slack = 1e-4f * edge_m_;
  for (const glm::uvec3 corner : mesh.triangles) {
    const glm::vec3 a = mesh.vertices[corner.x], b = mesh.vertices[corner.y], c = mesh.vertices[corner.z];
    const glm::ivec3 last = count_ - 1;
    const auto lower = glm::clamp(glm::ivec3(glm::floor((glm::min(a, glm::min(b, c)) - slack - origin_) / edge_m_)), glm::ivec3(0), last);
    const auto upper = glm::clamp(glm::ivec3(glm::floor((glm::max(a, glm::max(b, c)) + slack - origin_) / edge_m_)), glm::ivec3(0), last);
    for (int x = lower.x; x <= upper.x; ++x)
      for (int y = lower.y; y <= upper.y; ++y)
        for (int z = lower.z; z <= upper.z; ++z) holds[box_at({x, y, z})] = true;
  }
  return holds;
}

glm::ivec3 FieldGrid::index_of(std::size_t box) const {
  const auto i = static_cast<int>(box);
  return {i / (count_.y * count_.z), i / count_.z % count_.y, i % count_.z};
}

/// One of the jittered points of a box.
glm::vec3 FieldGrid::point_of(const glm::ivec3& box, const glm::ivec3& at) const {
  // The sequence of Roberts (2018) in three dimensions, from another start in each box: as even as jitter can be, and quick.
  constexpr glm::dvec3 step(0.8191725133961645, 0.6710436067037893, 0.5497004779019703);
  const auto number = static_cast<double>(number_of(at) + kPoints * (box_at(box) % 4096));
  const glm::vec3 inside = (glm::vec3(at) + glm::vec3(glm::fract(number * step))) / static_cast<float>(n);
  return origin_ + (glm::vec3(box) + inside) * edge_m_;
}

/// Groups of points of the box that see each other, from neighbour to neighbour, through more than a slit.
FieldGrid::Pieces FieldGrid::pieces_of(const glm::ivec3& index) const {
  std::array<glm::vec3, kPoints> point;
  for (int i = 0; i < kPoints; ++i) point[i] = point_of(index, point_at(i));
  // Lines from each point to the next one along each axis.
  std::array<std::array<bool, kPoints>, 3> open{};
  for (int i = 0; i < kPoints; ++i)
    for (int axis = 0; axis < 3; ++axis)
      open[axis][i] = point_at(i)[axis] + 1 < n && !scene_->rays().occluded(point[i], point[i + kStrides[axis]]);
  // Lines that are open side by side, three by three, join points: a slit lets a row or two of them through.
  constexpr int across = 3;
  Groups groups;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = kStrides[(axis + 1) % 3], v = kStrides[(axis + 2) % 3];
    for (int i = 0; i < kPoints; ++i) {
      const glm::ivec3 at = point_at(i);
      if (at[axis] + 1 == n || at[(axis + 1) % 3] + across > n || at[(axis + 2) % 3] + across > n) continue;
      bool all = true;
      for (int line = 0; all && line < across * across; ++line) all = open[axis][i + line / across * u + line % across * v];
      for (int line = 0; all && line < across * across; ++line) {
        const int from = i + line / across * u + line % across * v;
        groups.join(from, from + kStrides[axis]);
      }
    }
  }
  std::array<int, kPoints> size{};
  for (int i = 0; i < kPoints; ++i) ++size[groups.find(i)];
  // What is left over, in thin layers of air, goes to the nearest group that a line leads to, or is a group of its own.
  constexpr int unknown = -1;
  std::array<int, kPoints> group;
  for (int i = 0; i < kPoints; ++i) group[i] = size[groups.find(i)] >= static_cast<int>(kLeastPoints) ? groups.find(i) : unknown;
  const auto along_lines = [&](int i, auto&& visit) {
    const glm::ivec3 at = point_at(i);
    for (int axis = 0; axis < 3; ++axis) {
      if (open[axis][i]) visit(i + kStrides[axis]);
      if (at[axis] > 0 && open[axis][i - kStrides[axis]]) visit(i - kStrides[axis]);
    }
  };
  const std::array<int, kPoints> core = group;
  // Where two groups have as many lines to a point, as beside a slit, its neighbours come first.
  const auto grow = [&](bool ties) {
    bool grows = false;
    const std::array<int, kPoints> before = group;
    for (int i = 0; i < kPoints; ++i) {
      if (before[i] != unknown) continue;
      std::array<int, 6> next_groups{};
      int count = 0;
      along_lines(i, [&](int next) {
        if (before[next] != unknown) next_groups[count++] = before[next];
      });
      int best = unknown, most = 0;
      bool tied = false;
      for (int k = 0; k < count; ++k) {
        const auto lines = static_cast<int>(std::count(next_groups.begin(), next_groups.begin() + count, next_groups[k]));
        tied = lines == most ? tied || next_groups[k] != best : lines < most && tied;
        if (lines > most || (lines == most && next_groups[k] < best)) most = lines, best = next_groups[k];
      }
      if (best == unknown || (tied && !ties)) continue;
      group[i] = best;
      grows = true;
    }
    return grows;
  };
  while (grow(false) || grow(true)) {
  }
  Groups rest;
  for (int i = 0; i < kPoints; ++i)
    if (group[i] == unknown)
      along_lines(i, [&](int next) {
        if (group[next] == unknown) rest.join(i, next);
      });
  for (int i = 0; i < kPoints; ++i)
    if (group[i] == unknown) group[i] = rest.find(i);

  std::array<std::vector<int>, kPoints> members;
  for (int i = 0; i < kPoints; ++i) members[group[i]].push_back(i);
  std::sort(members.begin(), members.end(),
            [](const auto& a, const auto& b) { return a.size() != b.size() ? a.size() > b.size() : !a.empty() && a.front() < b.front(); });
  Pieces pieces{.cells = {}, .label = std::vector<std::uint8_t>(kPoints, kNoPiece)};
  const float point_m3 = edge_m_.x * edge_m_.y * edge_m_.z / kPoints;
  for (const std::vector<int>& of_piece : members) {
    if (of_piece.size() < kLeastPoints) break;
    for (const int i : of_piece) pieces.label[i] = static_cast<std::uint8_t>(pieces.cells.size());
    Cell piece{.volume_m3 = point_m3 * static_cast<float>(of_piece.size())};
    piece.num_views = static_cast<std::uint32_t>(std::min(kViews, of_piece.size()));
    // Spread over the piece, from the middle of its list on; not in what may lie in a slit.
    std::vector<int> inner;
    std::copy_if(of_piece.begin(), of_piece.end(), std::back_inserter(inner), [&](int i) { return core[i] != unknown; });
    const std::vector<int>& seen = inner.size() >= kViews ? inner : of_piece;
    for (std::uint32_t i = 0; i < piece.num_views; ++i)
      piece.view[i] = point[seen[(2 * ((i + piece.num_views / 2) % piece.num_views) + 1) * seen.size() / (2 * piece.num_views)]];
    piece.lower = piece.upper = point[of_piece[0]];
    for (const int i : of_piece) piece.lower = glm::min(piece.lower, point[i]), piece.upper = glm::max(piece.upper, point[i]);
    // The outermost of the many points along a wall lies a small part of their spacing from it.
    piece.lower -= 0.5f / n * edge_m_;
    piece.upper += 0.5f / n * edge_m_;
    pieces.cells.push_back(piece);
  }
  return pieces;
}

bool FieldGrid::visible_from(const Cell& cell, glm::vec3 point) const {
  for (std::uint32_t i = 0; i < cell.num_views; ++i)
    if (!scene_->rays().occluded(point, cell.view[i])) return true;
  return false;
}

/// The place of a point among the points of its box.
glm::ivec3 FieldGrid::place_in(std::size_t box, glm::vec3 point) const {
  return glm::clamp(glm::ivec3(((point - origin_) / edge_m_ - glm::vec3(index_of(box))) * static_cast<float>(n)), 0, n - 1);
}

/// The piece of a box that holds a point, as far as that is known without a ray; none where it is not.
std::uint32_t FieldGrid::sure_piece_at(std::size_t box, glm::vec3 point) const {
  const Box& cells = boxes_[box];
  if (cells.labels == none) return cells.first;
  // Mostly bounds tell, as a straight wall leaves its two sides apart, or the points all round it belong to one piece.
  const auto inside = [&](glm::vec3 lower, glm::vec3 upper) {
    return glm::all(glm::greaterThanEqual(point, lower)) && glm::all(glm::lessThanEqual(point, upper));
  };
  if (cells.stray == none || !inside(stray_[cells.stray].lower, stray_[cells.stray].upper)) {
    std::uint32_t only = none, candidates = 0;
    for (std::uint32_t cell = cells.first; cell < cells.first + cells.count; ++cell)
      if (inside(cells_[cell].lower, cells_[cell].upper)) only = cell, ++candidates;
    if (candidates == 1) return only;
  }
  const std::uint8_t* label = &labels_[cells.labels];
  const glm::ivec3 at = place_in(box, point);
  const int i = number_of(at);
  bool same = label[i] < kStrayAir;
  const auto may_be = [&](int other) { return label[other] == label[i] || label[other] == kNoPiece; };
  for (int axis = 0; axis < 3; ++axis) {
    same = same && (at[axis] == 0 || may_be(i - kStrides[axis]));
    same = same && (at[axis] + 1 == n || may_be(i + kStrides[axis]));
  }
  return same ? cells.first + label[i] : none;
}

std::uint32_t FieldGrid::piece_at(std::size_t box, glm::vec3 point) const {
  if (boxes_[box].count == 0) return none;
  const std::uint32_t sure = sure_piece_at(box, point);
  return sure != none ? sure : piece_near_walls(box, point);
}

/// The piece that a segment crosses between two of its points.  It is free of geometry: where the middle lies near a wall, another point
/// tells as well.
std::uint32_t FieldGrid::piece_along(std::size_t box, glm::vec3 enter, glm::vec3 leave) const {
  if (boxes_[box].count == 0) return none;
  for (const float part : {0.5f, 0.25f, 0.75f})
    if (const std::uint32_t sure = sure_piece_at(box, enter + part * (leave - enter)); sure != none) return sure;
  return piece_near_walls(box, 0.5f * (enter + leave));
}

/// Near a wall: the piece of the nearest points that are visible.  Lines to them are short, so seldom through a slit.
std::uint32_t FieldGrid::piece_near_walls(std::size_t box, glm::vec3 point) const {
  const Box& cells = boxes_[box];
  const glm::ivec3 index = index_of(box), at = place_in(box, point);
  const std::uint8_t* label = &labels_[cells.labels];
  const auto sees = [&](const glm::ivec3& other) {
    return label[number_of(other)] < kStrayAir && !scene_->rays().occluded(point, point_of(index, other));
  };
  if (sees(at)) return cells.first + label[number_of(at)];
  // Those beside it by a face, an edge, a corner.
  for (int distance = 1; distance <= 3; ++distance)
    for (int step = 0; step < 27; ++step) {
      const glm::ivec3 by(step / 9 - 1, step / 3 % 3 - 1, step % 3 - 1), other = at + by;
      if (std::abs(by.x) + std::abs(by.y) + std::abs(by.z) != distance) continue;
      if (glm::clamp(other, 0, n - 1) == other && sees(other)) return cells.first + label[number_of(other)];
    }
  return none;
}

/// Does a passage join two cells?
bool FieldGrid::joined(std::uint32_t cell, std::uint32_t other) const {
  return std::binary_search(neighbours_.begin() + neighbours_begin_[cell], neighbours_.begin() + neighbours_begin_[cell + 1], other);
}

void FieldGrid::cross(glm::vec3 origin, glm::vec3 direction, float length_m, std::vector<Crossing>& crossings) const {
  if (cells_.empty()) return;
  // Amanatides and Woo 1987: from box to box by the nearest of the three next planes.  Which axis comes next is as good as random: no
  // branch and no index depends on it.
  const glm::ivec3 index = glm::clamp(glm::ivec3(glm::floor((origin - origin_) / edge_m_)), glm::ivec3(0), count_ - 1);
  struct Axis {
    float next_m, step_m;  // to the next plane, and from plane to plane
    int left, stride;      // boxes before the border, and how far apart they are stored
  };
  const auto axis_of = [&](int axis, int stride) {
    const bool backward = direction[axis] < 0;
    const float inverse = 1.f / direction[axis];
    const float plane = origin_[axis] + static_cast<float>(index[axis] + (backward ? 0 : 1)) * edge_m_[axis];
    return Axis{.next_m = direction[axis] == 0 ? std::numeric_limits<float>::infinity() : std::max((plane - origin[axis]) * inverse, 0.f),
                .step_m = std::fabs(edge_m_[axis] * inverse),
                .left = backward ? index[axis] : count_[axis] - 1 - index[axis],
                .stride = backward ? -stride : stride};
  };
  Axis x = axis_of(0, count_.y * count_.z), y = axis_of(1, count_.z), z = axis_of(2, 1);
  auto box = static_cast<std::ptrdiff_t>(box_at(index));
  // What rounding puts across the border of a box, which may be a wall: such a sliver goes to the next cell, and at the end to none.
  const float least_m = 1e-5f * std::min({edge_m_.x, edge_m_.y, edge_m_.z});
  float enter_m = 0;
  while (enter_m < length_m) {
    const float nearest_m = std::min(x.next_m, std::min(y.next_m, z.next_m)), leave_m = std::min(nearest_m, length_m);
    if (leave_m > enter_m + least_m) {
      const std::uint32_t cell = piece_along(static_cast<std::size_t>(box), origin + enter_m * direction, origin + leave_m * direction);
      if (cell != none) crossings.push_back({cell, enter_m, leave_m});
      enter_m = leave_m;
    }
    if (leave_m >= length_m) return;
    const bool by_x = x.next_m == nearest_m, by_y = !by_x && y.next_m == nearest_m, by_z = !by_x && !by_y;
    x.left -= by_x ? 1 : 0;
    y.left -= by_y ? 1 : 0;
    z.left -= by_z ? 1 : 0;
    if ((x.left | y.left | z.left) < 0) return;
    box += by_x ? x.stride : by_y ? y.stride : z.stride;
    x.next_m += by_x ? x.step_m : 0.f;
    y.next_m += by_y ? y.step_m : 0.f;
    z.next_m += by_z ? z.step_m : 0.f;
  }
}

/// Corners of a cube by their distance from one, as bits that differ.
constexpr std::array<int, 8> kByDistance{0, 1, 2, 4, 3, 5, 6, 7};

std::size_t FieldGrid::blend(glm::vec3 point, std::array<CellWeight, 8>& weights) const {
  if (cells_.empty()) return 0;
  const glm::vec3 place = (point - origin_) / edge_m_;
  const glm::ivec3 last = count_ - 1;
  const auto own = glm::clamp(glm::ivec3(glm::floor(place)), glm::ivec3(0), last);
  const glm::vec3 from_centre = place - 0.5f, low = glm::floor(from_centre), fraction = from_centre - low;
  const glm::ivec3 corner_box = glm::ivec3(low);
  struct Corner {
    std::size_t box;
    float weight;
    std::uint32_t cell;
  };
  std::array<Corner, 8> corners;
  int own_corner = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const glm::ivec3 side(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    float weight = 1;
    for (int axis = 0; axis < 3; ++axis) weight *= side[axis] ? fraction[axis] : 1.f - fraction[axis];
    const auto index = glm::clamp(corner_box + side, glm::ivec3(0), last);
    corners[corner] = {box_at(index), weight, none};
    // Beside a border of the grid several corners are one box: the own one is that of the point's side.
    if (index == own) own_corner = corner;
  }
  // From the own cell, over passages between the boxes round the point, to those of the corners: one, two, or three steps away.
  corners[own_corner].cell = piece_at(corners[own_corner].box, point);
  const std::uint32_t own_cell = corners[own_corner].cell;
  std::size_t count = 0;
  float sum = 0;
  for (const int steps : {0, 1, 2, 3, 4, 5, 6, 7}) {
    const int corner = own_corner ^ kByDistance[steps];
    Corner& here = corners[corner];
    const Box& box = boxes_[here.box];
    if (box.count == 0) continue;
    if (here.box == corners[own_corner].box) here.cell = own_cell;
    for (std::uint32_t i = box.first; here.cell == none && i < box.first + box.count; ++i) {
      bool reached = own_cell == none;
      for (const int axis : {1, 2, 4}) {
        const std::uint32_t before = corners[corner ^ axis].cell;
        reached = reached || (before != none && (before == i || joined(before, i)));
      }
      if (reached && visible_from(cells_[i], point)) here.cell = i;
    }
    if (here.cell == none || !(here.weight > 0)) continue;
    weights[count++] = {here.cell, here.weight};
    sum += here.weight;
  }
  if (count == 0) {
    // In a crack from which no cell is visible: the largest piece of its own box.
    const Box& box = boxes_[box_at(own)];
    if (box.count == 0) return 0;
    weights[0] = {box.first, 1.f};
    return 1;
  }
  for (std::size_t i = 0; i < count; ++i) weights[i].weight /= sum;
  return count;
}

/// Points of no piece that see air of a neighbouring box lie in a layer too thin for a piece, on the far side of a wall: what crosses it
/// must not count for the near side.
void FieldGrid::find_stray_air() {
  std::vector<std::uint8_t> found(labels_.size(), 0);
  tbb::parallel_for(std::size_t{0}, boxes_.size(), [&](std::size_t box) {
    const FlushDenormals flush;
    const Box& here = boxes_[box];
    if (here.labels == none) return;
    const glm::ivec3 index = index_of(box);
    for (int i = 0; i < kPoints; ++i) {
      if (labels_[here.labels + i] != kNoPiece) continue;
      const glm::ivec3 at = point_at(i);
      for (int axis = 0; axis < 3; ++axis) {
        if (at[axis] != 0 && at[axis] + 1 != n) continue;
        glm::ivec3 next = index, other = at;
        next[axis] += at[axis] == 0 ? -1 : 1;
        other[axis] = n - 1 - at[axis];
        if (next[axis] < 0 || next[axis] >= count_[axis]) continue;
        const Box& there = boxes_[box_at(next)];
        const bool is_air = there.count > 0 && (there.labels == none || labels_[there.labels + number_of(other)] != kNoPiece);
        if (is_air && !scene_->rays().occluded(point_of(index, at), point_of(next, other))) found[here.labels + i] = 1;
      }
    }
  });
  for (std::size_t i = 0; i < boxes_.size(); ++i) {
    Box& box = boxes_[i];
    for (int k = 0; box.labels != none && k < kPoints; ++k) {
      if (!found[box.labels + k]) continue;
      labels_[box.labels + k] = kStrayAir;
      const glm::vec3 point = point_of(index_of(i), point_at(k));
      if (box.stray == none) {
        box.stray = static_cast<std::uint32_t>(stray_.size());
        stray_.push_back({point, point});
      }
      Bounds& bounds = stray_[box.stray];
      bounds.lower = glm::min(bounds.lower, point - 0.5f / n * edge_m_);
      bounds.upper = glm::max(bounds.upper, point + 0.5f / n * edge_m_);
    }
  }
}

/// The piece of one of the points of a box.
std::uint32_t FieldGrid::cell_of(const Box& box, int number) const {
  if (box.labels == none) return box.count > 0 ? box.first : none;
  const std::uint8_t label = labels_[box.labels + static_cast<std::uint32_t>(number)];
  return label < kStrayAir ? box.first + label : none;
}

/// Passages through the face between a box and the next one along an axis.
void FieldGrid::find_passages_between(const glm::ivec3& index, int axis, std::vector<Passage>& found) const {
  glm::ivec3 next = index;
  ++next[axis];
  const Box &here = boxes_[box_at(index)], &there = boxes_[box_at(next)];
  // The points beside the face, of each piece, and the lines across it that are open.
  std::vector<int> points_here(here.count, 0), points_there(there.count, 0), open(here.count * there.count, 0);
  for (int i = 0; i < n * n; ++i) {
    glm::ivec3 at(0), other(0);
    at[axis] = n - 1;
    at[(axis + 1) % 3] = other[(axis + 1) % 3] = i / n;
    at[(axis + 2) % 3] = other[(axis + 2) % 3] = i % n;
    const std::uint32_t a = cell_of(here, number_of(at)), b = cell_of(there, number_of(other));
    if (a != none) ++points_here[a - here.first];
    if (b != none) ++points_there[b - there.first];
    if (a != none && b != none && !scene_->rays().occluded(point_of(index, at), point_of(next, other)))
      ++open[(a - here.first) * there.count + b - there.first];
  }
  for (std::uint32_t a = 0; a < here.count; ++a)
    for (std::uint32_t b = 0; b < there.count; ++b) {
      const int lines = open[a * there.count + b], most = std::min(points_here[a], points_there[b]);
      const float openness = static_cast<float>(lines) / static_cast<float>(std::max(most, 1));
      if (openness >= kLeastOpenness) found.push_back({here.first + a, there.first + b, openness});
    }
}

void FieldGrid::find_passages(const std::vector<bool>& holds_geometry) {
  std::vector<std::vector<Passage>> of_box(boxes_.size());
  tbb::parallel_for(std::size_t{0}, boxes_.size(), [&](std::size_t i) {
    const FlushDenormals flush;
    const glm::ivec3 index = index_of(i);
    for (int axis = 0; axis < 3; ++axis) {
      glm::ivec3 next = index;
      if (++next[axis] == count_[axis]) continue;
      if (holds_geometry[i] || holds_geometry[box_at(next)])
        find_passages_between(index, axis, of_box[i]);
      else
        of_box[i].push_back({boxes_[i].first, boxes_[box_at(next)].first, 1.f});
    }
  });
  for (const std::vector<Passage>& some : of_box) passages_.insert(passages_.end(), some.begin(), some.end());
  std::sort(passages_.begin(), passages_.end(),
            [](const Passage& a, const Passage& b) { return std::pair(a.first, a.second) < std::pair(b.first, b.second); });
  std::vector<std::vector<std::uint32_t>> neighbours(cells_.size());
  for (const Passage& p : passages_) {
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

}  // namespace earshot
