#include "sim/acoustics/geometry/box_pieces.h"

#include <algorithm>
#include <glm/common.hpp>
#include <iterator>
#include <numeric>

namespace earshot {
namespace {

constexpr std::size_t kLeastPoints = 12;  // of a piece
constexpr std::array<int, 3> kStrides = FieldBoxes::kStrides;

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
  std::array<int, FieldBoxes::kPoints> parent_{};
};

}  // namespace

BoxPieces whole_box(const FieldBoxes& boxes, const glm::ivec3& index) {
  const glm::vec3 edge_m = boxes.edge_m();
  AirPiece whole{.volume_m3 = edge_m.x * edge_m.y * edge_m.z, .num_views = 1};
  whole.view[0] = boxes.origin() + (glm::vec3(index) + 0.5f) * edge_m;
  return {.pieces = {whole}, .label = {}};
}

BoxPieces find_box_pieces(const Scene& scene, const FieldBoxes& boxes, const glm::ivec3& index) {
  const glm::vec3 edge_m = boxes.edge_m();
  std::array<glm::vec3, FieldBoxes::kPoints> point;
  for (int i = 0; i < FieldBoxes::kPoints; ++i) point[i] = boxes.lattice_point(index, FieldBoxes::lattice_place(i));
  // Lines from each point to the next one along each axis.
  std::array<std::array<bool, FieldBoxes::kPoints>, 3> open{};
  for (int i = 0; i < FieldBoxes::kPoints; ++i)
    for (int axis = 0; axis < 3; ++axis)
      open[axis][i] = FieldBoxes::lattice_place(i)[axis] + 1 < FieldBoxes::kPointsPerEdge &&
                      !scene.rays().occluded(point[i], point[i + kStrides[axis]]);
  // Lines that are open side by side, three by three, join points: a slit lets a row or two of them through.
  constexpr int across = 3;
  Groups groups;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = kStrides[(axis + 1) % 3], v = kStrides[(axis + 2) % 3];
    for (int i = 0; i < FieldBoxes::kPoints; ++i) {
      const glm::ivec3 at = FieldBoxes::lattice_place(i);
      if (at[axis] + 1 == FieldBoxes::kPointsPerEdge || at[(axis + 1) % 3] + across > FieldBoxes::kPointsPerEdge ||
          at[(axis + 2) % 3] + across > FieldBoxes::kPointsPerEdge)
        continue;
      bool all = true;
      for (int line = 0; all && line < across * across; ++line) all = open[axis][i + line / across * u + line % across * v];
      for (int line = 0; all && line < across * across; ++line) {
        const int from = i + line / across * u + line % across * v;
        groups.join(from, from + kStrides[axis]);
      }
    }
  }
  std::array<int, FieldBoxes::kPoints> size{};
  for (int i = 0; i < FieldBoxes::kPoints; ++i) ++size[groups.find(i)];
  // What is left over, in thin layers of air, goes to the nearest group that a line leads to, or is a group of its own.
  constexpr int unknown = -1;
  std::array<int, FieldBoxes::kPoints> group;
  for (int i = 0; i < FieldBoxes::kPoints; ++i)
    group[i] = size[groups.find(i)] >= static_cast<int>(kLeastPoints) ? groups.find(i) : unknown;
  const auto along_lines = [&](int i, auto&& visit) {
    const glm::ivec3 at = FieldBoxes::lattice_place(i);
    for (int axis = 0; axis < 3; ++axis) {
      if (open[axis][i]) visit(i + kStrides[axis]);
      if (at[axis] > 0 && open[axis][i - kStrides[axis]]) visit(i - kStrides[axis]);
    }
  };
  const std::array<int, FieldBoxes::kPoints> core = group;
  // Where two groups have as many lines to a point, as beside a slit, its neighbours come first.
  const auto grow = [&](bool ties) {
    bool grows = false;
    const std::array<int, FieldBoxes::kPoints> before = group;
    for (int i = 0; i < FieldBoxes::kPoints; ++i) {
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
  for (int i = 0; i < FieldBoxes::kPoints; ++i)
    if (group[i] == unknown)
      along_lines(i, [&](int next) {
        if (group[next] == unknown) rest.join(i, next);
      });
  for (int i = 0; i < FieldBoxes::kPoints; ++i)
    if (group[i] == unknown) group[i] = rest.find(i);

  std::array<std::vector<int>, FieldBoxes::kPoints> members;
  for (int i = 0; i < FieldBoxes::kPoints; ++i) members[group[i]].push_back(i);
  std::sort(members.begin(), members.end(),
            [](const auto& a, const auto& b) { return a.size() != b.size() ? a.size() > b.size() : !a.empty() && a.front() < b.front(); });
  BoxPieces found{.pieces = {}, .label = std::vector<std::uint8_t>(FieldBoxes::kPoints, BoxPieces::kNoPiece)};
  const float point_m3 = edge_m.x * edge_m.y * edge_m.z / FieldBoxes::kPoints;
  for (const std::vector<int>& of_piece : members) {
    if (of_piece.size() < kLeastPoints) break;
    for (const int i : of_piece) found.label[i] = static_cast<std::uint8_t>(found.pieces.size());
    AirPiece piece{.volume_m3 = point_m3 * static_cast<float>(of_piece.size())};
    piece.num_views = static_cast<std::uint32_t>(std::min(AirPiece::kViews, of_piece.size()));
    // Spread over the piece, from the middle of its list on; not in what may lie in a slit.
    std::vector<int> inner;
    std::copy_if(of_piece.begin(), of_piece.end(), std::back_inserter(inner), [&](int i) { return core[i] != unknown; });
    const std::vector<int>& seen = inner.size() >= AirPiece::kViews ? inner : of_piece;
    for (std::uint32_t i = 0; i < piece.num_views; ++i)
      piece.view[i] = point[seen[(2 * ((i + piece.num_views / 2) % piece.num_views) + 1) * seen.size() / (2 * piece.num_views)]];
    piece.lower = piece.upper = point[of_piece[0]];
    for (const int i : of_piece) piece.lower = glm::min(piece.lower, point[i]), piece.upper = glm::max(piece.upper, point[i]);
    // The outermost of the many points along a wall lies a small part of their spacing from it.
    piece.lower -= 0.5f / FieldBoxes::kPointsPerEdge * edge_m;
    piece.upper += 0.5f / FieldBoxes::kPointsPerEdge * edge_m;
    found.pieces.push_back(piece);
  }
  return found;
}

}  // namespace earshot
