// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/box_pieces.h"

#include <algorithm>
#include <glm/common.hpp>
#include <iterator>
#include <numeric>

namespace earshot {
namespace {

constexpr std::size_t kMinPoints = 12;  // of a piece
constexpr std::uint32_t kUngrouped = VisibleMajority::no_group;

/// Sets that grow together.
class Groups {
 public:
  Groups() { std::iota(parent_.begin(), parent_.end(), 0u); }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a), b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::array<std::uint32_t, FieldBoxes::kPoints> parent_{};
};

/// The group of each point, or kUngrouped.
using GroupOfPoint = std::array<std::uint32_t, FieldBoxes::kPoints>;
using Points = std::array<glm::vec3, FieldBoxes::kPoints>;

/// Joins the points of the box at both ends of lines.
void join_along(const LatticeBits& lines, int axis, Groups& groups) {
  for (int i = 0; i < FieldBoxes::kPoints; ++i) {
    const glm::ivec3 at = FieldBoxes::lattice_place(i);
    if (at[axis] + 1 < FieldBoxes::kPointsPerEdge && lines.test(at + LatticeBits::kMargin))
      groups.join(static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(i + FieldBoxes::kStrides[static_cast<std::size_t>(axis)]));
  }
}

/// Groups of points joined through windows: three by three open lines side by side, as a slit lets a row or two of them through.  Smaller
/// ones than a piece are left ungrouped.
GroupOfPoint group_by_windows(const OpenWindows& windows) {
  Groups groups;
  for (int axis = 0; axis < 3; ++axis) join_along(windows.along(axis), axis, groups);
  GroupOfPoint group;
  std::array<std::size_t, FieldBoxes::kPoints> size{};
  for (std::uint32_t i = 0; i < group.size(); ++i) ++size[group[i] = groups.find(i)];
  for (std::uint32_t& of_point : group)
    if (size[of_point] < kMinPoints) of_point = kUngrouped;
  return group;
}

/// Points that no window holds: beside a corner or a slit they go to the group that most of the visible points round them belong to.
GroupOfPoint add_visible_points(const Scene& scene, const Points& points, const GroupOfPoint& core) {
  GroupOfPoint group = core;
  for (int i = 0; i < FieldBoxes::kPoints; ++i) {
    if (core[i] != kUngrouped) continue;
    VisibleMajority majority;
    const glm::ivec3 at = FieldBoxes::lattice_place(i), last(FieldBoxes::kPointsPerEdge - 1);
    for_each_place(glm::max(at - 1, 0), glm::min(at + 1, last), [&](const glm::ivec3& place) {
      const auto other = static_cast<std::size_t>(FieldBoxes::lattice_number(place));
      if (core[other] != kUngrouped) majority.add(core[other], !scene.rays().occluded(points[i], points[other]));
    });
    group[i] = majority.group();
  }
  return group;
}

/// Groups those that are left, as in gaps behind furniture, by open lines between them.
void group_rest(const OpenWindows& windows, GroupOfPoint& group) {
  Groups rest;
  for (int axis = 0; axis < 3; ++axis) {
    LatticeBits between;
    for (int i = 0; i < FieldBoxes::kPoints; ++i) {
      const glm::ivec3 at = FieldBoxes::lattice_place(i);
      if (group[i] != kUngrouped || at[axis] + 1 == FieldBoxes::kPointsPerEdge) continue;
      if (group[i + FieldBoxes::kStrides[static_cast<std::size_t>(axis)]] == kUngrouped &&
          windows.lines(axis).test(at + LatticeBits::kMargin))
        between.set(at + LatticeBits::kMargin);
    }
    join_along(between, axis, rest);
  }
  for (std::uint32_t i = 0; i < group.size(); ++i)
    if (group[i] == kUngrouped) group[i] = rest.find(i);
}

/// Points of each group, the largest group first.
std::array<std::vector<int>, FieldBoxes::kPoints> members_by_size(const GroupOfPoint& group) {
  std::array<std::vector<int>, FieldBoxes::kPoints> members;
  for (int i = 0; i < FieldBoxes::kPoints; ++i) members[group[i]].push_back(i);
  std::sort(members.begin(), members.end(),
            [](const auto& a, const auto& b) { return a.size() != b.size() ? a.size() > b.size() : !a.empty() && a.front() < b.front(); });
  return members;
}

/// core: groups through windows alone.
AirPiece make_piece(glm::vec3 edge_m, const Points& points, const std::vector<int>& members, const GroupOfPoint& core) {
  const float point_m3 = edge_m.x * edge_m.y * edge_m.z / FieldBoxes::kPoints;
  AirPiece piece{.volume_m3 = point_m3 * static_cast<float>(members.size())};
  piece.num_views = static_cast<std::uint32_t>(std::min(AirPiece::kViews, members.size()));
  // Spread over the piece, from the middle of its list on; not in what may lie in a slit.
  std::vector<int> inner;
  std::copy_if(members.begin(), members.end(), std::back_inserter(inner), [&](int i) { return core[i] != kUngrouped; });
  const std::vector<int>& seen = inner.size() >= AirPiece::kViews ? inner : members;
  for (std::uint32_t i = 0; i < piece.num_views; ++i)
    piece.view[i] = points[seen[(2 * ((i + piece.num_views / 2) % piece.num_views) + 1) * seen.size() / (2 * piece.num_views)]];
  return piece;
}

}  // namespace

BoxPieces whole_box(const FieldBoxes& boxes, const glm::ivec3& index) {
  const glm::vec3 edge_m = boxes.edge_m();
  AirPiece whole{.volume_m3 = edge_m.x * edge_m.y * edge_m.z, .num_views = 1};
  whole.view[0] = boxes.origin() + (glm::vec3(index) + 0.5f) * edge_m;
  return {.pieces = {whole}, .label = {}};
}

BoxPieces find_box_pieces(const Scene& scene, const FieldBoxes& boxes, const OpenWindows& windows, const glm::ivec3& index) {
  Points points;
  for (int i = 0; i < FieldBoxes::kPoints; ++i) points[i] = boxes.lattice_point(index, FieldBoxes::lattice_place(i));
  const GroupOfPoint core = group_by_windows(windows);
  GroupOfPoint group = add_visible_points(scene, points, core);
  group_rest(windows, group);

  BoxPieces found{.pieces = {}, .label = std::vector<std::uint8_t>(FieldBoxes::kPoints, BoxPieces::kNoPiece)};
  for (const std::vector<int>& members : members_by_size(group)) {
    if (members.size() < kMinPoints) break;
    for (const int i : members) found.label[i] = static_cast<std::uint8_t>(found.pieces.size());
    found.pieces.push_back(make_piece(boxes.edge_m(), points, members, core));
  }
  return found;
}

}  // namespace earshot
