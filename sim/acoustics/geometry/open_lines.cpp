#include "sim/acoustics/geometry/open_lines.h"

#include <glm/common.hpp>

namespace earshot {
namespace {

constexpr int kWindowLines = LatticeBits::kMargin + 1;  // along each edge of a window
constexpr int kEdge = LatticeBits::kEdge, kMargin = LatticeBits::kMargin;

}  // namespace

LatticeBits LatticeBits::moved(int axis, int by) const {
  LatticeBits bits;
  for (int x = 0; x < kEdge; ++x)
    for (int y = 0; y < kEdge; ++y) {
      const int from_x = x - (axis == 0 ? by : 0), from_y = y - (axis == 1 ? by : 0);
      if (from_x < 0 || from_x >= kEdge || from_y < 0 || from_y >= kEdge) continue;
      const unsigned row = row_[row_of({from_x, from_y, 0})];
      bits.row_[row_of({x, y, 0})] = static_cast<std::uint16_t>(axis != 2 ? row : by < 0 ? row >> -by : row << by & ((1u << kEdge) - 1));
    }
  return bits;
}

LatticeBits LatticeBits::eroded(int axis, int count) const {
  LatticeBits bits = *this;
  for (int by = 1; by < count; ++by) bits = bits & moved(axis, -by);
  return bits;
}

LatticeBits LatticeBits::dilated(int axis, int count) const {
  LatticeBits bits = *this;
  for (int by = 1; by < count; ++by) bits = bits | moved(axis, by);
  return bits;
}

LatticeBits OpenLines::find_windows(int axis) const {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const auto at_both_ends = [&](int side) { return along(side) & along(side).moved(axis, -1); };
  const LatticeBits windows = along(axis).eroded(u, kWindowLines).eroded(v, kWindowLines) &
                              at_both_ends(u).eroded(u, kWindowLines - 1).eroded(v, kWindowLines) &
                              at_both_ends(v).eroded(u, kWindowLines).eroded(v, kWindowLines - 1);
  return windows.dilated(u, kWindowLines).dilated(v, kWindowLines);
}

std::uint64_t OpenLines::across(int axis) const {
  std::uint64_t bits = 0;
  glm::ivec3 at(0);
  at[axis] = kMargin + FieldBoxes::kPointsPerEdge - 1;
  for (int i = 0; i < FieldBoxes::kPointsPerEdge * FieldBoxes::kPointsPerEdge; ++i) {
    at[(axis + 1) % 3] = kMargin + i / FieldBoxes::kPointsPerEdge;
    at[(axis + 2) % 3] = kMargin + i % FieldBoxes::kPointsPerEdge;
    bits |= std::uint64_t{in_windows(axis).test(at)} << i;
  }
  return bits;
}

OpenLines::OpenLines(const Scene& scene, const FieldBoxes& boxes, const WallParts& walls, const glm::ivec3& index) {
  const glm::ivec3 first = index * FieldBoxes::kPointsPerEdge - kMargin, count = boxes.count() * FieldBoxes::kPointsPerEdge;
  LatticeBits inside, beside_wall;
  std::array<glm::vec3, kEdge * kEdge * kEdge> points;
  const auto point = [&](const glm::ivec3& at) -> glm::vec3& {
    return points[static_cast<std::size_t>((at.x * kEdge + at.y) * kEdge + at.z)];
  };
  for_each_place(glm::ivec3(0), glm::ivec3(kEdge - 1), [&](const glm::ivec3& at) {
    const glm::ivec3 place = first + at;
    if (glm::clamp(place, glm::ivec3(0), count - 1) != place) return;
    inside.set(at);
    const glm::ivec3 box = place / FieldBoxes::kPointsPerEdge, in_box = place - box * FieldBoxes::kPointsPerEdge;
    if (walls.touch_part(boxes.number_of(box), FieldBoxes::lattice_number(in_box))) beside_wall.set(at);
  });
  LatticeBits known;
  const auto point_at = [&](const glm::ivec3& at) {
    if (!known.test(at)) {
      const glm::ivec3 place = first + at, box = place / FieldBoxes::kPointsPerEdge;
      point(at) = boxes.lattice_point(box, place - box * FieldBoxes::kPointsPerEdge);
      known.set(at);
    }
    return point(at);
  };
  for_each_place(glm::ivec3(0), glm::ivec3(kEdge - 1), [&](const glm::ivec3& at) {
    if (!inside.test(at)) return;
    for (int axis = 0; axis < 3; ++axis) {
      glm::ivec3 next = at;
      if (++next[axis] == kEdge || !inside.test(next)) continue;
      // Two parts side by side make a box: what touches neither does not cut the line.
      if ((!beside_wall.test(at) && !beside_wall.test(next)) || !scene.rays().occluded(point_at(at), point_at(next)))
        open_[static_cast<std::size_t>(axis)].set(at);
    }
  });
  for (int axis = 0; axis < 3; ++axis) windows_[static_cast<std::size_t>(axis)] = find_windows(axis);
}

}  // namespace earshot
