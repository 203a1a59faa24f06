// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/field_grid.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <limits>
#include <numeric>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/geometry/mesh_sides.h"

namespace earshot {
namespace {

/// Corners of a cube by their distance from one, as bits that differ.
constexpr std::array<int, 8> kByDistance{0, 1, 2, 4, 3, 5, 6, 7};

/// What rays from the cells of a room meet first.
struct RoomSight {
  double fronts = 0, backs = 0;  ///< of triangles
  double free_m = 0;             ///< sum of the lengths of these rays
  double escaped = 0;            ///< rays that meet nothing
  [[nodiscard]] double seen() const { return fronts + backs; }
};

/// Calls visit(origin, direction) with 16 directions from each of at most eight cells.
template <typename Visit>
void look_around(const FieldGrid& grid, std::span<const std::uint32_t> cells, const Visit& visit) {
  constexpr std::size_t most_cells = 8;
  constexpr std::uint32_t directions = 16;
  const std::size_t views = std::min(cells.size(), most_cells);
  for (std::size_t view = 0; view < views; ++view)
    for (std::uint32_t i = 0; i < directions; ++i)
      visit(grid.inside(cells[view * cells.size() / views]),
            SphereSequence(0, 0).direction(static_cast<std::uint32_t>(view) * directions + i));
}

RoomSight sight_of(const Scene& scene, const FieldGrid& grid, std::span<const std::uint32_t> cells) {
  RoomSight sight;
  look_around(grid, cells, [&](glm::vec3 origin, glm::vec3 direction) {
    const Hit hit = scene.rays().intersect(origin, direction);
    if (!hit.valid()) {
      ++sight.escaped;
      return;
    }
    ++(meets_front(scene.mesh(), hit.triangle, direction) ? sight.fronts : sight.backs);
    sight.free_m += double{hit.distance_m};
  });
  return sight;
}

}  // namespace

FieldGrid::FieldGrid(const Scene& scene, float cell_m) : cells_(scene, cell_m), passages_(cells_) {
  find_rooms();
  find_bodies(scene);
}

/// Numbers rooms in the order of their first cells.
void FieldGrid::find_rooms() {
  constexpr float least_m3 = 1.f;
  // Every tree of cells hangs from its lowest one (disjoint sets, Tarjan 1975).
  std::vector<std::uint32_t> above(size());
  std::iota(above.begin(), above.end(), 0u);
  const auto root = [&](std::uint32_t cell) {
    for (; above[cell] != cell; cell = above[cell]) above[cell] = above[above[cell]];
    return cell;
  };
  for (const Passage& passage : passages()) {
    const std::uint32_t first = root(passage.first), second = root(passage.second);
    above[std::max(first, second)] = std::min(first, second);
  }
  std::vector<float> air_m3(size(), 0.f);
  for (std::uint32_t cell = 0; cell < size(); ++cell) air_m3[root(cell)] += volume_m3(cell);
  room_.assign(size(), no_room);
  for (std::uint32_t cell = 0; cell < size(); ++cell) {
    const std::uint32_t of_room = root(cell);
    if (of_room == cell && air_m3[cell] >= least_m3) room_[cell] = num_rooms_++;
    room_[cell] = room_[of_room];
  }
}

void FieldGrid::find_bodies(const Scene& scene) {
  constexpr double of_one_side = 2.0 / 3.0, narrow_m = 1.2, open_to_the_sky = 0.1;
  inside_body_.assign(num_rooms_, false);
  if (num_rooms_ < 2) return;
  std::vector<std::vector<std::uint32_t>> cells(num_rooms_);
  std::vector<double> air_m3(num_rooms_, 0.0);
  for (std::uint32_t cell = 0; cell < size(); ++cell) {
    if (room(cell) == no_room) continue;
    cells[room(cell)].push_back(cell);
    air_m3[room(cell)] += double{volume_m3(cell)};
  }
  std::vector<RoomSight> sights;
  double facing_m3 = 0, closed_m3 = 0;  // air whose walls turn their fronts to it, less that whose walls turn their backs to it
  for (std::uint32_t number = 0; number < num_rooms_; ++number) {
    const RoomSight sight = sights.emplace_back(sight_of(scene, *this, cells[number]));
    if (sight.seen() == 0 || sight.escaped > open_to_the_sky * (sight.seen() + sight.escaped)) continue;
    facing_m3 += air_m3[number] * (sight.fronts - sight.backs) / sight.seen();
    closed_m3 += air_m3[number];
  }
  if (std::fabs(facing_m3) < (2 * of_one_side - 1) * closed_m3) return;
  std::vector<bool> turned(num_rooms_, false);
  for (std::uint32_t number = 0; number < num_rooms_; ++number) {
    const RoomSight& sight = sights[number];
    const double of_others = facing_m3 > 0 ? sight.backs : sight.fronts;
    turned[number] = sight.seen() > 0 && of_others >= of_one_side * sight.seen() && sight.free_m < narrow_m * sight.seen();
  }
  for (std::uint32_t number = 0; number < num_rooms_; ++number)
    inside_body_[number] = turned[number] && !leads_between_rooms(scene, cells[number], turned);
}

/// Do rays from these cells come to two rooms or more behind the first wall?  turned: [rooms] those that do not count.
bool FieldGrid::leads_between_rooms(const Scene& scene, std::span<const std::uint32_t> cells, const std::vector<bool>& turned) const {
  std::uint32_t beyond = no_room;
  bool several = false;
  std::vector<Crossing> crossings;
  look_around(*this, cells, [&](glm::vec3 origin, glm::vec3 direction) {
    const Hit hit = scene.rays().intersect(origin, direction);
    if (!hit.valid() || several) return;
    const glm::vec3 exit = offset_from_surface(hit.position, -hit.normal);
    const Hit next = scene.rays().intersect(exit, direction);
    if (!next.valid()) return;
    crossings.clear();
    cross(exit, direction, next.distance_m, crossings);
    for (const Crossing& crossing : crossings) {
      const std::uint32_t number = room(crossing.cell);
      if (number == no_room || turned[number]) continue;
      several = several || (beyond != no_room && beyond != number);
      beyond = number;
    }
  });
  return several;
}

/// The cell of a box that a segment crosses, or no_cell.  known: the cell found without a ray.  previous_cell: a cell of this box or of one
/// beside it where the segment was, gap if it was in one of this box, none if that is not known.
std::uint32_t FieldGrid::cell_after(std::uint32_t previous_cell, std::uint32_t known, std::size_t box, glm::vec3 enter,
                                    glm::vec3 leave) const {
  if (known != no_cell) return known == AirCells::outside_cells ? no_cell : known;
  if (previous_cell == gap) return no_cell;
  const AirCells::Box& box_cells = cells_.box(box);
  const glm::vec3 middle = 0.5f * (enter + leave);
  if (previous_cell != no_cell && !cells_.may_be_stray(box, middle)) {
    if (previous_cell >= box_cells.first && previous_cell < box_cells.first + box_cells.count) return previous_cell;
    std::uint32_t joined_cell = no_cell, candidates = 0;
    for (std::uint32_t cell = box_cells.first; cell < box_cells.first + box_cells.count; ++cell)
      if (passages_.joined(previous_cell, cell)) joined_cell = cell, ++candidates;
    if (candidates == 1) return joined_cell;
  }
  return cells_.cell_at(box, middle);
}

std::uint32_t FieldGrid::cross(glm::vec3 origin, glm::vec3 direction, float length_m, std::vector<Crossing>& crossings,
                               std::uint32_t start) const {
  if (cells_.size() == 0) return no_cell;
  if (!(length_m > 0)) return start;
  const FieldBoxes& boxes = cells_.boxes();
  const glm::vec3 edge_m = boxes.edge_m();
  const glm::ivec3 num_boxes = boxes.count();
  // Amanatides and Woo 1987: from box to box by the nearest of the three next planes.  Which axis comes next is as good as random: no
  // branch and no index depends on it.
  glm::ivec3 index = boxes.index_at(origin);
  struct Axis {
    float next_m, step_m;  // to the next plane, and from plane to plane
    int left, stride;      // boxes before the border, and their distance in memory
    int to_next;           // of the index
  };
  const auto axis_of = [&](int axis, int stride) {
    const bool backward = direction[axis] < 0;
    const float inverse = 1.f / direction[axis];
    const float plane = boxes.origin()[axis] + static_cast<float>(index[axis] + (backward ? 0 : 1)) * edge_m[axis];
    return Axis{.next_m = direction[axis] == 0 ? std::numeric_limits<float>::infinity() : std::max((plane - origin[axis]) * inverse, 0.f),
                .step_m = std::fabs(edge_m[axis] * inverse),
                .left = backward ? index[axis] : num_boxes[axis] - 1 - index[axis],
                .stride = backward ? -stride : stride,
                .to_next = backward ? -1 : 1};
  };
  Axis x = axis_of(0, num_boxes.y * num_boxes.z), y = axis_of(1, num_boxes.z), z = axis_of(2, 1);
  auto box = static_cast<std::ptrdiff_t>(boxes.number_of(index));
  // Rounding may put a sliver of the segment across the border of a box, which may be a wall: it goes to the next cell, and at the end to
  // no cell.
  const float least_m = 1e-5f * std::min({edge_m.x, edge_m.y, edge_m.z});
  float enter_m = 0;
  std::uint32_t previous_cell = start, cell = start;
  const auto cover = [&](std::size_t number, std::uint32_t known, float from_m, float to_m) {
    cell = cell_after(previous_cell, known, number, origin + from_m * direction, origin + to_m * direction);
    if (cell != no_cell) crossings.push_back({cell, from_m, to_m});
    previous_cell = cell;
  };
  while (enter_m < length_m) {
    const float nearest_m = std::min(x.next_m, std::min(y.next_m, z.next_m)), leave_m = std::min(nearest_m, length_m);
    if (leave_m > enter_m + least_m) {
      const auto number = static_cast<std::size_t>(box);
      const std::array<std::uint32_t, 2> known =
          cells_.known_cells_along(number, index, origin + enter_m * direction, origin + leave_m * direction);
      const float middle_m = known[0] == known[1] ? leave_m : 0.5f * (enter_m + leave_m);
      cover(number, known[0], enter_m, middle_m);
      if (middle_m < leave_m) cover(number, known[1], middle_m, leave_m);
      enter_m = leave_m;
    }
    if (leave_m >= length_m) break;
    const bool by_x = x.next_m == nearest_m, by_y = !by_x && y.next_m == nearest_m, by_z = !by_x && !by_y;
    x.left -= by_x ? 1 : 0;
    y.left -= by_y ? 1 : 0;
    z.left -= by_z ? 1 : 0;
    if ((x.left | y.left | z.left) < 0) break;
    box += by_x ? x.stride : by_y ? y.stride : z.stride;
    index += glm::ivec3(by_x ? x.to_next : 0, by_y ? y.to_next : 0, by_z ? z.to_next : 0);
    x.next_m += by_x ? x.step_m : 0.f;
    y.next_m += by_y ? y.step_m : 0.f;
    z.next_m += by_z ? z.step_m : 0.f;
  }
  // A sliver at the end, or a segment that is one, may lie in another box.
  return cell == no_cell && enter_m >= length_m ? gap : cell;
}

std::size_t FieldGrid::blend(glm::vec3 point, std::array<CellWeight, 8>& weights) const {
  if (cells_.size() == 0) return 0;
  const FieldBoxes& boxes = cells_.boxes();
  const glm::vec3 place = (point - boxes.origin()) / boxes.edge_m();
  const glm::ivec3 last = boxes.count() - 1, own = boxes.index_at(point);
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
    corners[corner] = {boxes.number_of(index), weight, no_cell};
    // Beside a border of the grid several corners are one box: the own one is that of the point's side.
    if (index == own) own_corner = corner;
  }
  // From the own cell, over passages between the boxes round the point, to those of the corners: one, two, or three steps away.
  corners[own_corner].cell = cells_.cell_at(corners[own_corner].box, point);
  const std::uint32_t own_cell = corners[own_corner].cell;
  std::size_t count = 0;
  float sum = 0;
  for (const int steps : {0, 1, 2, 3, 4, 5, 6, 7}) {
    const int corner = own_corner ^ kByDistance[steps];
    Corner& corner_cell = corners[corner];
    const AirCells::Box& box = cells_.box(corner_cell.box);
    if (box.count == 0) continue;
    if (corner_cell.box == corners[own_corner].box) corner_cell.cell = own_cell;
    for (std::uint32_t i = box.first; corner_cell.cell == no_cell && i < box.first + box.count; ++i) {
      bool reached = own_cell == no_cell;
      for (const int axis : {1, 2, 4}) {
        const std::uint32_t previous_cell = corners[corner ^ axis].cell;
        reached = reached || (previous_cell != no_cell && (previous_cell == i || passages_.joined(previous_cell, i)));
      }
      if (reached && cells_.visible_from(i, point)) corner_cell.cell = i;
    }
    if (corner_cell.cell == no_cell || !(corner_cell.weight > 0)) continue;
    weights[count++] = {corner_cell.cell, corner_cell.weight};
    sum += corner_cell.weight;
  }
  if (count == 0) {
    // In a crack from which no cell is visible: the largest piece of its own box.
    const AirCells::Box& box = cells_.box(boxes.number_of(own));
    if (box.count == 0) return 0;
    weights[0] = {box.first, 1.f};
    return 1;
  }
  for (std::size_t i = 0; i < count; ++i) weights[i].weight /= sum;
  return count;
}

}  // namespace earshot
