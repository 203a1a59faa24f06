#include "sim/acoustics/geometry/box_pieces.h"

#include <algorithm>
#include <glm/common.hpp>
#include <iterator>
#include <numeric>

namespace earshot {
namespace {

constexpr std::size_t kLeastPoints = 12;  // of a piece
constexpr std::array<int, 3> kStrides = FieldBoxes::kStrides;
constexpr int kWindowLines = 3;  // along each edge of a window of lines
constexpr int kUngrouped = -1;

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

/// The lattice of one box, and which of its lines from each point to the next one along each axis are open.
struct BoxLattice {
  BoxLattice(const Scene& scene, const FieldBoxes& boxes, const glm::ivec3& index) : edge_m(boxes.edge_m()) {
    for (int i = 0; i < FieldBoxes::kPoints; ++i) point[i] = boxes.lattice_point(index, FieldBoxes::lattice_place(i));
    for (int i = 0; i < FieldBoxes::kPoints; ++i)
      for (int axis = 0; axis < 3; ++axis)
        open[axis][i] = FieldBoxes::lattice_place(i)[axis] + 1 < FieldBoxes::kPointsPerEdge &&
                        !scene.rays().occluded(point[i], point[i + kStrides[axis]]);
  }
  /// Calls visit(neighbour) for each point that an open line joins with point `i`.
  template <class Visit>
  void visit_neighbours(int i, Visit&& visit) const {
    const glm::ivec3 at = FieldBoxes::lattice_place(i);
    for (int axis = 0; axis < 3; ++axis) {
      if (open[axis][i]) visit(i + kStrides[axis]);
      if (at[axis] > 0 && open[axis][i - kStrides[axis]]) visit(i - kStrides[axis]);
    }
  }

  glm::vec3 edge_m;  ///< of the box
  std::array<glm::vec3, FieldBoxes::kPoints> point;
  std::array<std::array<bool, FieldBoxes::kPoints>, 3> open{};  ///< [axis][point]
};

/// The group of each point, or kUngrouped.
using GroupOfPoint = std::array<int, FieldBoxes::kPoints>;

/// Groups of points joined through windows: three by three open lines side by side, as a slit lets a row or two of them through.  Smaller
/// ones than a piece are left ungrouped.
GroupOfPoint group_by_windows(const BoxLattice& lattice) {
  Groups groups;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = kStrides[(axis + 1) % 3], v = kStrides[(axis + 2) % 3];
    for (int i = 0; i < FieldBoxes::kPoints; ++i) {
      const glm::ivec3 at = FieldBoxes::lattice_place(i);
      if (at[axis] + 1 == FieldBoxes::kPointsPerEdge || at[(axis + 1) % 3] + kWindowLines > FieldBoxes::kPointsPerEdge ||
          at[(axis + 2) % 3] + kWindowLines > FieldBoxes::kPointsPerEdge)
        continue;
      const auto start_of = [&](int line) { return i + line / kWindowLines * u + line % kWindowLines * v; };
      bool is_window = true;
      for (int line = 0; is_window && line < kWindowLines * kWindowLines; ++line) is_window = lattice.open[axis][start_of(line)];
      for (int line = 0; is_window && line < kWindowLines * kWindowLines; ++line)
        groups.join(start_of(line), start_of(line) + kStrides[axis]);
    }
  }
  std::array<int, FieldBoxes::kPoints> size{};
  for (int i = 0; i < FieldBoxes::kPoints; ++i) ++size[groups.find(i)];
  GroupOfPoint group;
  for (int i = 0; i < FieldBoxes::kPoints; ++i)
    group[i] = size[groups.find(i)] >= static_cast<int>(kLeastPoints) ? groups.find(i) : kUngrouped;
  return group;
}

/// The group that most open lines lead to from a point, the lowest of several; kUngrouped if there is none.
struct NextGroup {
  int group = kUngrouped;
  bool is_tied = false;  ///< as many lines lead to another one
};
NextGroup find_next_group(const BoxLattice& lattice, const GroupOfPoint& group, int i) {
  std::array<int, 6> next_groups{};
  int count = 0;
  lattice.visit_neighbours(i, [&](int next) {
    if (group[next] != kUngrouped) next_groups[count++] = group[next];
  });
  NextGroup best;
  int most = 0;
  for (int k = 0; k < count; ++k) {
    const auto lines = static_cast<int>(std::count(next_groups.begin(), next_groups.begin() + count, next_groups[k]));
    best.is_tied = lines == most ? best.is_tied || next_groups[k] != best.group : lines < most && best.is_tied;
    if (lines > most || (lines == most && next_groups[k] < best.group)) most = lines, best.group = next_groups[k];
  }
  return best;
}

enum class Ties { wait, decide };

/// Gives ungrouped points beside a group to it, all at once.  False if there is none.
bool grow_groups(const BoxLattice& lattice, Ties ties, GroupOfPoint& group) {
  bool grows = false;
  const GroupOfPoint previous = group;
  for (int i = 0; i < FieldBoxes::kPoints; ++i) {
    if (previous[i] != kUngrouped) continue;
    const NextGroup next = find_next_group(lattice, previous, i);
    if (next.group == kUngrouped || (next.is_tied && ties == Ties::wait)) continue;
    group[i] = next.group;
    grows = true;
  }
  return grows;
}

/// Groups the points that no line joins with a group among themselves.
void group_rest(const BoxLattice& lattice, GroupOfPoint& group) {
  Groups rest;
  for (int i = 0; i < FieldBoxes::kPoints; ++i)
    if (group[i] == kUngrouped)
      lattice.visit_neighbours(i, [&](int next) {
        if (group[next] == kUngrouped) rest.join(i, next);
      });
  for (int i = 0; i < FieldBoxes::kPoints; ++i)
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
AirPiece make_piece(const BoxLattice& lattice, const std::vector<int>& members, const GroupOfPoint& core) {
  const glm::vec3 edge_m = lattice.edge_m;
  const float point_m3 = edge_m.x * edge_m.y * edge_m.z / FieldBoxes::kPoints;
  AirPiece piece{.volume_m3 = point_m3 * static_cast<float>(members.size())};
  piece.num_views = static_cast<std::uint32_t>(std::min(AirPiece::kViews, members.size()));
  // Spread over the piece, from the middle of its list on; not in what may lie in a slit.
  std::vector<int> inner;
  std::copy_if(members.begin(), members.end(), std::back_inserter(inner), [&](int i) { return core[i] != kUngrouped; });
  const std::vector<int>& seen = inner.size() >= AirPiece::kViews ? inner : members;
  for (std::uint32_t i = 0; i < piece.num_views; ++i)
    piece.view[i] = lattice.point[seen[(2 * ((i + piece.num_views / 2) % piece.num_views) + 1) * seen.size() / (2 * piece.num_views)]];
  piece.lower = piece.upper = lattice.point[members[0]];
  for (const int i : members) {
    piece.lower = glm::min(piece.lower, lattice.point[i]);
    piece.upper = glm::max(piece.upper, lattice.point[i]);
  }
  // The outermost of the many points along a wall lies a small part of their spacing from it.
  piece.lower -= 0.5f / FieldBoxes::kPointsPerEdge * edge_m;
  piece.upper += 0.5f / FieldBoxes::kPointsPerEdge * edge_m;
  return piece;
}

}  // namespace

BoxPieces whole_box(const FieldBoxes& boxes, const glm::ivec3& index) {
  const glm::vec3 edge_m = boxes.edge_m();
  AirPiece whole{.volume_m3 = edge_m.x * edge_m.y * edge_m.z, .num_views = 1};
  whole.view[0] = boxes.origin() + (glm::vec3(index) + 0.5f) * edge_m;
  return {.pieces = {whole}, .label = {}};
}

BoxPieces find_box_pieces(const Scene& scene, const FieldBoxes& boxes, const glm::ivec3& index) {
  const BoxLattice lattice(scene, boxes, index);
  const GroupOfPoint core = group_by_windows(lattice);
  // Points left over, in thin layers of air, go to the nearest group that a line leads to, or form groups of their own.  Where two groups
  // have as many lines to a point, as beside a slit, its neighbours come first.
  GroupOfPoint group = core;
  while (grow_groups(lattice, Ties::wait, group) || grow_groups(lattice, Ties::decide, group)) {
  }
  group_rest(lattice, group);

  BoxPieces found{.pieces = {}, .label = std::vector<std::uint8_t>(FieldBoxes::kPoints, BoxPieces::kNoPiece)};
  for (const std::vector<int>& members : members_by_size(group)) {
    if (members.size() < kLeastPoints) break;
    for (const int i : members) found.label[i] = static_cast<std::uint8_t>(found.pieces.size());
    found.pieces.push_back(make_piece(lattice, members, core));
  }
  return found;
}

}  // namespace earshot
