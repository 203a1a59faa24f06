// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/panel_shapes.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "sim/base/memory_bytes.h"

namespace earshot {
namespace {

constexpr double kLeastAlong = 0.94;     // cosine of 20 degrees: a side may slope by as much
constexpr double kLeastCovered = 0.75;   // of a side by edges
constexpr double kSheetFraction = 0.25;  // faces narrower than this of the panel make it a sheet
constexpr double kSheetRad = 2.0 * std::numbers::pi - 0.35;
constexpr double kLeastUpright = 0.99;   // cosine of 8 degrees: a base may slope by as much
constexpr double kOffM = 2e-3;           // of rays along a panel
constexpr double kWallM = 0.03;          // a wall beside a panel is as near to its end
constexpr std::size_t kMostSides = 256;  // of one plane; scans of many pieces have no panels
constexpr double kJointM = 0.02;         // a panel stands where it comes as near to its base

glm::dvec3 end_of(const PanelEdge& edge) { return edge.start + edge.length_m * edge.along; }

bool touch(const PanelEdge& a, const PanelEdge& b) {
  const double tolerance_m = 0.02 * std::min(a.length_m, b.length_m);
  for (const glm::dvec3 p : {a.start, end_of(a)})
    for (const glm::dvec3 q : {b.start, end_of(b)})
      if (glm::length(p - q) < tolerance_m) return true;
  return false;
}

/// Free edges of a panel as the four sides of a rectangle, by axis and end: [0] against the axis, [1] along it.
struct PanelSides {
  glm::dvec3 origin{0}, normal{0};
  std::array<glm::dvec3, 2> axis{};
  std::array<std::array<double, 2>, 2> at_m{};      ///< along the axis from the origin, in the mean
  std::array<std::array<double, 2>, 2> length_m{};  ///< of the edges of a side together; 0: none
  std::array<std::array<double, 2>, 2> reach_m{};   ///< least and most of all edges along each axis
  double widest_other_m = 0;                        ///< face beside the panel at its edges
  bool is_rim = true;                               ///< is every edge that of a sheet?

  [[nodiscard]] bool is_closed() const { return length_m[0][0] > 0 && length_m[0][1] > 0 && length_m[1][0] > 0 && length_m[1][1] > 0; }
};

/// 2 / (3 E) of an ellipse is 4 / (3 pi) for a disc; a strip has pi / 4 of its half width.  E by a fit within 1 %.
double low_ratio(double shorter_m, double longer_m) {
  const double integral = 1.0 + (0.5 * std::numbers::pi - 1.0) * std::pow(shorter_m / longer_m, 1.5);
  return 0.25 * std::numbers::pi * (0.5 * shorter_m) / integral;
}

bool set_size(const PanelSides& sides, PanelShape& shape) {
  const double shorter = 2.0 * std::min(shape.half_side_m[0], shape.half_side_m[1]),
               longer = 2.0 * std::max(shape.half_side_m[0], shape.half_side_m[1]);
  if (!(shorter >= kLeastPanelM) || shorter > kWideFaceM) return false;  // a hole has sides below 0
  shape.is_sheet = sides.is_rim || sides.widest_other_m < kSheetFraction * shorter;
  shape.low_ratio_m = low_ratio(shorter, longer);
  return true;
}

Hit along(const Scene& scene, glm::dvec3 from, glm::dvec3 direction, double most_m) {
  return scene.rays().intersect(glm::vec3(from), glm::vec3(direction), static_cast<float>(most_m));
}

enum class PanelEnd { air, wall, other };

/// How a panel ends, end_m from a point beside its middle.  Edges shorter than AcousticConfig::diffraction_edge_m are not known.
PanelEnd end_of(const Scene& scene, std::span<const std::uint32_t> plane_of_triangle, std::uint32_t plane, glm::dvec3 from,
                glm::dvec3 direction, glm::dvec3 normal, double end_m) {
  const Hit wall = along(scene, from, direction, end_m + kWallM);
  if (wall.valid()) {
    const bool is_wall = double{wall.distance_m} > end_m - kWallM && std::abs(glm::dot(glm::dvec3(wall.normal), direction)) > kLeastUpright;
    return is_wall ? PanelEnd::wall : PanelEnd::other;
  }
  const Hit face = along(scene, from + (end_m + kWallM) * direction, -normal, 2 * kOffM);
  return face.valid() && plane_of_triangle[face.triangle] == plane ? PanelEnd::other : PanelEnd::air;
}

/// Nothing where an edge slopes by more than 20 degrees against the longest.
std::optional<PanelSides> sides_of(std::span<const PanelEdge* const> edges) {
  const PanelEdge* longest = edges.front();
  for (const PanelEdge* const edge : edges)
    if (edge->length_m > longest->length_m) longest = edge;
  PanelSides sides;
  sides.normal = longest->normal;
  sides.axis = {longest->along, glm::normalize(glm::cross(longest->normal, longest->along))};
  sides.origin = longest->start;
  sides.reach_m.fill({std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()});
  for (const PanelEdge* const edge : edges) {
    bool known = false;
    for (std::size_t a = 0; a < 2; ++a) {
      for (const double m : {0.0, edge->length_m}) {
        const double at_m = glm::dot(edge->start + m * edge->along - sides.origin, sides.axis[a]);
        sides.reach_m[a] = {std::min(sides.reach_m[a][0], at_m), std::max(sides.reach_m[a][1], at_m)};
      }
      const double outward = glm::dot(edge->outward, sides.axis[a]);
      if (std::abs(outward) < kLeastAlong) continue;
      known = true;
      const std::size_t end = outward > 0 ? 1 : 0;
      sides.at_m[a][end] += edge->length_m * glm::dot(edge->start + 0.5 * edge->length_m * edge->along - sides.origin, sides.axis[a]);
      sides.length_m[a][end] += edge->length_m;
    }
    if (!known) return {};
    sides.is_rim = sides.is_rim && edge->exterior_rad > kSheetRad;
    sides.widest_other_m = std::max(sides.widest_other_m, edge->other_width_m);
  }
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t end = 0; end < 2; ++end)
      if (sides.length_m[a][end] > 0) sides.at_m[a][end] /= sides.length_m[a][end];
  return sides;
}

/// Of sides that close.  Nothing if edges cover less than three quarters of a side, or its size is out of range (panel_shapes.h).
std::optional<PanelShape> free_panel(const PanelSides& sides) {
  PanelShape shape;
  shape.normal = sides.normal;
  shape.axis = sides.axis;
  shape.centre = sides.origin;
  for (std::size_t a = 0; a < 2; ++a) {
    shape.half_side_m[a] = 0.5 * (sides.at_m[a][1] - sides.at_m[a][0]);
    shape.centre += 0.5 * (sides.at_m[a][1] + sides.at_m[a][0]) * shape.axis[a];
  }
  if (!set_size(sides, shape)) return {};
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t end = 0; end < 2; ++end)
      if (sides.length_m[a][end] < kLeastCovered * 2.0 * shape.half_side_m[1 - a]) return {};
  return shape;
}

/// Of sides of which one at least is missing: a thin panel that ends there at another surface at a right angle, as rays tell, and opposite
/// in the air.  axis[1] of the shape is `up`.  Nothing if there is no such surface.
std::optional<PanelShape> standing_panel(const Scene& scene, std::span<const std::uint32_t> plane_of_triangle, std::uint32_t plane,
                                         const PanelSides& sides) {
  // The axis with one free side is upright: that is the top.
  const auto free_sides = [&](std::size_t a) { return (sides.length_m[a][0] > 0 ? 1 : 0) + (sides.length_m[a][1] > 0 ? 1 : 0); };
  if ((free_sides(0) == 1) == (free_sides(1) == 1)) return {};
  const std::size_t up = free_sides(0) == 1 ? 0 : 1, level = 1 - up, top = sides.length_m[up][1] > 0 ? 1 : 0;
  PanelShape shape;
  shape.normal = sides.normal;
  shape.up = (top == 1 ? 1.0 : -1.0) * sides.axis[up];
  shape.axis = {sides.axis[level], shape.up};
  const double top_m = (top == 1 ? 1.0 : -1.0) * sides.at_m[up][top];
  std::array<double, 2> end_m;
  for (std::size_t end = 0; end < 2; ++end)
    end_m[end] = sides.length_m[level][end] > 0 ? sides.at_m[level][end] : sides.reach_m[level][end];
  const double length_m = end_m[1] - end_m[0];
  if (!(length_m > 0) || sides.length_m[up][top] < kLeastCovered * length_m) return {};
  const glm::dvec3 top_middle = sides.origin + 0.5 * (end_m[0] + end_m[1]) * shape.axis[0] + top_m * shape.up;

  // Down along the panel to its base.
  const glm::dvec3 start = top_middle + kOffM * shape.normal - kOffM * shape.up;
  const Hit base = along(scene, start, -shape.up, kWideFaceM);
  if (!base.valid() || std::abs(glm::dot(glm::dvec3(base.normal), shape.up)) < kLeastUpright) return {};
  const double height_m = double{base.distance_m} + kOffM;
  for (std::size_t end = 0; end < 2; ++end)
    if (sides.length_m[level][end] > 0 && sides.length_m[level][end] < kLeastCovered * height_m) return {};
  for (const double m : {0.1, 0.5}) {
    const Hit face = along(scene, top_middle - (1 - m) * height_m * shape.up + kOffM * shape.normal, -shape.normal, 2 * kOffM);
    if (!face.valid() || plane_of_triangle[face.triangle] != plane) return {};
  }
  shape.half_side_m = {0.5 * length_m, height_m};
  shape.centre = top_middle - height_m * shape.up;
  // Ends at walls: on by its mirror image there.
  const glm::dvec3 middle = top_middle - 0.5 * height_m * shape.up + kOffM * shape.normal;
  for (std::size_t end = 0; end < 2; ++end) {
    if (sides.length_m[level][end] > 0) continue;
    const double outward = end == 0 ? -1 : 1;
    const PanelEnd how = end_of(scene, plane_of_triangle, plane, middle, outward * shape.axis[0], shape.normal, 0.5 * length_m);
    if (how == PanelEnd::other) return {};
    if (how == PanelEnd::air) continue;
    shape.half_side_m[0] += 0.5 * length_m;
    shape.centre += 0.5 * outward * length_m * shape.axis[0];
  }
  if (!set_size(sides, shape) || !shape.is_sheet) return {};
  shape.base_plane = plane_of_triangle[base.triangle];
  if (shape.base_plane == plane) return {};
  const glm::dvec3 behind = top_middle - 0.5 * height_m * shape.up - kOffM * shape.normal;
  const Hit back = along(scene, behind, -shape.normal, kSheetFraction * height_m);
  // Not a wall close behind a sheet.
  const bool is_thick = !sides.is_rim && back.valid() && double{back.distance_m} <= sides.widest_other_m + 2 * kOffM &&
                        std::abs(glm::dot(glm::dvec3(back.normal), shape.normal)) > kLeastUpright;
  shape.back_plane = is_thick ? plane_of_triangle[back.triangle] : plane;
  return shape;
}

}  // namespace

glm::dvec3 PanelShape::nearest(glm::dvec3 point) const {
  glm::dvec3 result = centre;
  for (std::size_t i = 0; i < 2; ++i) result += std::clamp(glm::dot(point - centre, axis[i]), -half_side_m[i], half_side_m[i]) * axis[i];
  return result;
}

bool PanelShape::holds(glm::dvec3 point) const {
  return std::abs(glm::dot(point - centre, axis[0])) <= half_side_m[0] && std::abs(glm::dot(point - centre, axis[1])) <= half_side_m[1];
}

PanelShapes::PanelShapes(const Scene& scene, const PanelEdges& edges, std::span<const std::uint32_t> plane_of_triangle,
                         std::size_t num_planes, std::size_t num_edges, bool with_standing) {
  std::vector<const PanelEdge*> members;
  for (std::uint32_t plane = 0; plane < num_planes; ++plane) {
    const std::span<const PanelEdge> sides = edges.of(plane);
    if (sides.size() > kMostSides) continue;
    std::vector<std::uint8_t> done(sides.size(), 0);
    for (std::size_t first = 0; first < sides.size(); ++first) {
      if (done[first] != 0) continue;
      members.assign(1, &sides[first]);
      done[first] = 1;
      for (std::size_t next = 0; next < members.size(); ++next)
        for (std::size_t i = first + 1; i < sides.size(); ++i) {
          if (done[i] != 0 || glm::dot(sides[i].normal, sides[first].normal) < 0.9 || !touch(*members[next], sides[i])) continue;
          done[i] = 1;
          members.push_back(&sides[i]);
        }
      if (std::optional<PanelSides> found = sides_of(members)) {
        if (!found->is_closed() && !with_standing) continue;
        if (std::optional<PanelShape> shape =
                found->is_closed() ? free_panel(*found) : standing_panel(scene, plane_of_triangle, plane, *found)) {
          shape->plane = plane;
          shapes_.push_back(*shape);
        }
      }
    }
  }
  add_backs(scene, plane_of_triangle);
  sort(num_planes);
  find_bases();
  if (shapes_.empty()) return;
  panel_of_face_.assign(2 * num_edges, kNone);
  for (std::uint32_t plane = 0; plane < num_planes; ++plane)
    for (const PanelEdge& side : edges.of(plane)) {
      const glm::dvec3 inside = side.start + 0.5 * side.length_m * side.along - 1e-3 * side.outward;
      if (const PanelShape* const shape = find(plane, inside, inside + side.normal); shape != nullptr)
        panel_of_face_[2 * side.edge + (side.is_first_face ? 0 : 1)] = static_cast<std::uint32_t>(shape - shapes_.data());
    }
}

bool PanelShapes::ends_in_air(const Scene& scene, std::span<const std::uint32_t> plane_of_triangle, const PanelShape& base) const {
  const auto stands_on_it = [&](std::uint32_t plane) {
    return std::ranges::any_of(shapes_, [&](const PanelShape& panel) {
      return panel.base_plane == base.plane && (panel.plane == plane || panel.back_plane == plane);
    });
  };
  constexpr int most_panels = 16;
  for (std::size_t a = 0; a < 2; ++a)
    for (const double sign : {-1.0, 1.0})
      for (const double beside : {-0.45, 0.05, 0.55}) {
        const glm::dvec3 direction = sign * base.axis[a];
        glm::dvec3 from = base.centre + kOffM * base.normal + beside * base.half_side_m[1 - a] * base.axis[1 - a];
        double left_m = base.half_side_m[a] + kWallM;
        for (int i = 0; left_m > 0; ++i) {
          const Hit hit = along(scene, from, direction, left_m);
          if (!hit.valid()) break;
          if (i == most_panels || !stands_on_it(plane_of_triangle[hit.triangle])) return false;
          const double step_m = double{hit.distance_m} + kOffM;
          from += step_m * direction, left_m -= step_m;
        }
      }
  return true;
}

void PanelShapes::add_backs(const Scene& scene, std::span<const std::uint32_t> plane_of_triangle) {
  const auto back_of = [](PanelShape shape) {
    shape.normal = -shape.normal;
    shape.is_sheet = true;
    return shape;
  };
  const auto at = [&](std::uint32_t plane, glm::dvec3 normal, glm::dvec3 point) {
    return std::ranges::find_if(shapes_, [&](const PanelShape& shape) {
      return shape.plane == plane && glm::dot(shape.normal, normal) > 0.9 && glm::length(shape.nearest(point) - point) < kJointM;
    });
  };
  // Of two that end at each other the lower one stands on the other.
  const std::vector<PanelShape> all_found = shapes_;
  std::erase_if(shapes_, [&](const PanelShape& panel) {
    return panel.stands() && std::ranges::any_of(all_found, [&](const PanelShape& other) {
             const bool on_each_other = other.base_plane == panel.plane && other.plane == panel.base_plane;
             return on_each_other && glm::length(other.centre - panel.centre) < kJointM + other.half_side_m[0] &&
                    std::pair(other.height_m(), other.plane) < std::pair(panel.height_m(), panel.plane);
           });
  });
  const std::size_t count = shapes_.size();
  for (std::size_t i = 0; i < count; ++i) {
    if (!shapes_[i].stands()) continue;
    const PanelShape panel = shapes_[i];
    // Where the base ends at the panel, the panel's other side is free all round.
    if (panel.back_plane == panel.plane) {
      const auto other = at(panel.plane, -panel.normal, panel.centre + 0.25 * panel.height_m() * panel.up);
      if (other == shapes_.end()) {
        shapes_.push_back(back_of(panel));
      } else {
        *other = back_of(panel);
      }
    }
    // The base of panels that stand at its ends has no free edges on their side.
    if (at(panel.base_plane, panel.up, panel.centre) != shapes_.end()) continue;
    const auto below = at(panel.base_plane, -panel.up, panel.centre);
    if (below == shapes_.end() || below->stands()) continue;
    if (const PanelShape base = back_of(*below); ends_in_air(scene, plane_of_triangle, base)) shapes_.push_back(base);
  }
}

void PanelShapes::sort(std::size_t num_planes) {
  std::ranges::stable_sort(shapes_, {}, &PanelShape::plane);
  begin_.assign(num_planes + 1, 0);
  for (const PanelShape& shape : shapes_) ++begin_[shape.plane + 1];
  for (std::size_t plane = 0; plane < num_planes; ++plane) begin_[plane + 1] += begin_[plane];
}

void PanelShapes::find_bases() {
  for (PanelShape& panel : shapes_) {
    if (!panel.stands()) continue;
    for (std::size_t i = begin_[panel.base_plane]; i < begin_[panel.base_plane + 1]; ++i)
      if (!shapes_[i].stands() && glm::dot(shapes_[i].normal, panel.up) > 0.9 &&
          glm::length(shapes_[i].nearest(panel.centre) - panel.centre) < kJointM)
        panel.base_panel = static_cast<std::uint32_t>(i);
  }
}

const PanelShape* PanelShapes::find(std::uint32_t plane, glm::dvec3 point, glm::dvec3 from) const {
  for (std::size_t i = begin_[plane]; i < begin_[plane + 1]; ++i)
    if (shapes_[i].holds(point) && glm::dot(shapes_[i].normal, from - shapes_[i].centre) > 0) return &shapes_[i];
  return nullptr;
}

std::vector<std::uint32_t> PanelShapes::largest_from(glm::dvec3 source, std::size_t most) const {
  std::vector<std::pair<double, std::uint32_t>> seen;  // by the angle that they fill, about
  for (std::uint32_t i = 0; i < shapes_.size(); ++i) {
    if (!shapes_[i].faces(source) || (shapes_[i].stands() && glm::dot(source - shapes_[i].centre, shapes_[i].up) <= 0)) continue;
    const double height_m = glm::dot(source - shapes_[i].centre, shapes_[i].normal),
                 away_m = glm::length(source - shapes_[i].nearest(source));
    seen.emplace_back(-shapes_[i].area_m2() * height_m / (away_m * away_m * away_m), i);
  }
  std::sort(seen.begin(), seen.end());
  seen.resize(std::min(seen.size(), most));
  std::vector<std::uint32_t> indices;
  for (const auto& [angle, index] : seen) indices.push_back(index);
  return indices;
}

std::size_t PanelShapes::bytes() const { return bytes_of(shapes_) + bytes_of(begin_) + bytes_of(panel_of_face_); }

}  // namespace earshot
