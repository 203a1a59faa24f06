#include "sim/acoustics/geometry/field_grid.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/vector_relational.hpp>
#include <numeric>
#include <utility>

#include "sim/base/denormals.h"
#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr float kMaxBoxes = 16'384.f;
/// Points along each edge of a box that find its pieces and their volumes: jittered, so a wall that cuts a box is off by about 1 % of it.
constexpr int kPointsPerEdge = 8;
constexpr int kPoints = kPointsPerEdge * kPointsPerEdge * kPointsPerEdge;
/// Pieces of fewer points are gaps behind furniture or the inside of walls: too small to know their volume.
constexpr std::size_t kLeastPoints = 12;

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
  std::vector<std::vector<Cell>> pieces(holds_geometry.size());
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
    const FlushDenormals flush;
    const auto box = static_cast<int>(i);
    const glm::ivec3 index(box / (count_.y * count_.z), box / count_.z % count_.y, box % count_.z);
    if (holds_geometry[i]) {
      pieces[i] = pieces_of(index);
    } else {
      Cell whole{.volume_m3 = edge_m_.x * edge_m_.y * edge_m_.z, .num_views = 1};
      whole.view[0] = origin_ + (glm::vec3(index) + 0.5f) * edge_m_;
      pieces[i].push_back(whole);
    }
  });
  for (const std::vector<Cell>& of_box : pieces) {
    boxes_.push_back({.first = static_cast<std::uint32_t>(cells_.size()), .count = static_cast<std::uint32_t>(of_box.size())});
    cells_.insert(cells_.end(), of_box.begin(), of_box.end());
  }
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

/// Groups of points of the box that see each other, from neighbour to neighbour.
std::vector<FieldGrid::Cell> FieldGrid::pieces_of(const glm::ivec3& index) const {
  constexpr int n = kPointsPerEdge;
  std::array<glm::vec3, kPoints> point;
  const auto at = [](int x, int y, int z) { return (x * n + y) * n + z; };
  const RandomStream random(0, Purpose::surface_sample, static_cast<std::uint32_t>(box_at(index)));
  for (int x = 0; x < n; ++x)
    for (int y = 0; y < n; ++y)
      for (int z = 0; z < n; ++z) {
        const auto u = random.uniform4(static_cast<std::uint32_t>(at(x, y, z)));
        const glm::vec3 inside = (glm::vec3(x, y, z) + glm::vec3(u[0], u[1], u[2])) / static_cast<float>(n);
        point[at(x, y, z)] = origin_ + (glm::vec3(index) + inside) * edge_m_;
      }
  Groups groups;
  const auto join = [&](int a, int b) {
    if (groups.find(a) != groups.find(b) && !scene_->rays().occluded(point[a], point[b])) groups.join(a, b);
  };
  for (int x = 0; x < n; ++x)
    for (int y = 0; y < n; ++y)
      for (int z = 0; z < n; ++z) {
        if (x + 1 < n) join(at(x, y, z), at(x + 1, y, z));
        if (y + 1 < n) join(at(x, y, z), at(x, y + 1, z));
        if (z + 1 < n) join(at(x, y, z), at(x, y, z + 1));
      }
  std::array<std::vector<int>, kPoints> members;
  for (int i = 0; i < kPoints; ++i) members[groups.find(i)].push_back(i);
  std::sort(members.begin(), members.end(),
            [](const auto& a, const auto& b) { return a.size() != b.size() ? a.size() > b.size() : !a.empty() && a.front() < b.front(); });
  std::vector<Cell> pieces;
  const float point_m3 = edge_m_.x * edge_m_.y * edge_m_.z / kPoints;
  for (const std::vector<int>& group : members) {
    if (group.size() < kLeastPoints) break;
    Cell piece{.volume_m3 = point_m3 * static_cast<float>(group.size())};
    piece.num_views = static_cast<std::uint32_t>(std::min(kViews, group.size()));
    // Spread over the piece, from the middle of its list on.
    for (std::uint32_t i = 0; i < piece.num_views; ++i)
      piece.view[i] = point[group[(2 * ((i + piece.num_views / 2) % piece.num_views) + 1) * group.size() / (2 * piece.num_views)]];
    piece.lower = piece.upper = point[group[0]];
    for (const int i : group) piece.lower = glm::min(piece.lower, point[i]), piece.upper = glm::max(piece.upper, point[i]);
    // The outermost of the many points along a wall lies a small part of their spacing from it.
    piece.lower -= 0.5f / n * edge_m_;
    piece.upper += 0.5f / n * edge_m_;
    pieces.push_back(piece);
  }
  return pieces;
}

bool FieldGrid::visible_from(const Cell& cell, glm::vec3 point) const {
  for (std::uint32_t i = 0; i < cell.num_views; ++i)
    if (!scene_->rays().occluded(point, cell.view[i])) return true;
  return false;
}

std::uint32_t FieldGrid::piece_at(const Box& box, glm::vec3 point) const {
  if (box.count == 0) return none;
  if (box.count == 1) return box.first;
  // Mostly bounds tell already: a straight wall leaves its two sides apart.
  std::uint32_t only = none, candidates = 0;
  const auto may_hold = [&](const Cell& cell) {
    return glm::all(glm::greaterThanEqual(point, cell.lower)) && glm::all(glm::lessThanEqual(point, cell.upper));
  };
  for (std::uint32_t i = box.first; i < box.first + box.count; ++i)
    if (may_hold(cells_[i])) only = i, ++candidates;
  if (candidates == 1) return only;
  for (std::uint32_t i = box.first; i < box.first + box.count; ++i)
    if (may_hold(cells_[i]) && visible_from(cells_[i], point)) return i;
  return none;
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
      const std::uint32_t cell = piece_at(boxes_[static_cast<std::size_t>(box)], origin + 0.5f * (enter_m + leave_m) * direction);
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

std::size_t FieldGrid::blend(glm::vec3 point, std::array<CellWeight, 8>& weights) const {
  if (cells_.empty()) return 0;
  const glm::vec3 place = (point - origin_) / edge_m_;
  const glm::ivec3 last = count_ - 1;
  const auto own = glm::clamp(glm::ivec3(glm::floor(place)), glm::ivec3(0), last);
  const glm::vec3 from_centre = place - 0.5f, low = glm::floor(from_centre), fraction = from_centre - low;
  std::size_t count = 0;
  float sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const glm::ivec3 side(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    float weight = 1;
    for (int axis = 0; axis < 3; ++axis) weight *= side[axis] ? fraction[axis] : 1.f - fraction[axis];
    const auto index = glm::clamp(glm::ivec3(low) + side, glm::ivec3(0), last);
    const Box& box = boxes_[box_at(index)];
    if (!(weight > 0) || box.count == 0) continue;
    std::uint32_t found = none;
    if (index == own && box.count == 1) found = box.first;
    for (std::uint32_t i = box.first; found == none && i < box.first + box.count; ++i)
      if (visible_from(cells_[i], point)) found = i;
    if (found == none) continue;
    weights[count++] = {found, weight};
    sum += weight;
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

float FieldGrid::openness(const Cell& a, const Cell& b) const {
  const std::uint32_t lines = std::max(a.num_views, b.num_views);
  std::uint32_t free = 0;
  for (std::uint32_t i = 0; i < lines; ++i)
    if (!scene_->rays().occluded(a.view[i % a.num_views], b.view[i % b.num_views])) ++free;
  return static_cast<float>(free) / static_cast<float>(lines);
}

std::vector<FieldGrid::Passage> FieldGrid::passages() const {
  std::vector<std::vector<Passage>> of_box(boxes_.size());
  tbb::parallel_for(std::size_t{0}, boxes_.size(), [&](std::size_t i) {
    const FlushDenormals flush;
    const auto box = static_cast<int>(i);
    const glm::ivec3 index(box / (count_.y * count_.z), box / count_.z % count_.y, box % count_.z);
    for (int axis = 0; axis < 3; ++axis) {
      glm::ivec3 next = index;
      if (++next[axis] == count_[axis]) continue;
      const Box &here = boxes_[i], &there = boxes_[box_at(next)];
      for (std::uint32_t a = here.first; a < here.first + here.count; ++a)
        for (std::uint32_t b = there.first; b < there.first + there.count; ++b)
          if (const float open = openness(cells_[a], cells_[b]); open > 0) of_box[i].push_back({a, b, open});
    }
  });
  std::vector<Passage> all;
  for (const std::vector<Passage>& some : of_box) all.insert(all.end(), some.begin(), some.end());
  std::sort(all.begin(), all.end(),
            [](const Passage& a, const Passage& b) { return std::pair(a.first, a.second) < std::pair(b.first, b.second); });
  return all;
}

}  // namespace earshot
