// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/panel_shapes.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <utility>

#include "sim/base/memory_bytes.h"

namespace earshot {
namespace {

constexpr double kLeastAlong = 0.94;     // cosine of 20 degrees: a side may slope by as much
constexpr double kLeastCovered = 0.75;   // of a side by edges
constexpr double kSheetFraction = 0.25;  // faces narrower than this of the panel make it a sheet
constexpr std::size_t kMostSides = 256;  // of one plane; scans of many pieces have no panels
constexpr double kSheetRad = 2.0 * std::numbers::pi - 0.35;

glm::dvec3 end_of(const PanelEdge& edge) { return edge.start + edge.length_m * edge.along; }

bool touch(const PanelEdge& a, const PanelEdge& b) {
  const double tolerance_m = 0.02 * std::min(a.length_m, b.length_m);
  for (const glm::dvec3 p : {a.start, end_of(a)})
    for (const glm::dvec3 q : {b.start, end_of(b)})
      if (glm::length(p - q) < tolerance_m) return true;
  return false;
}

/// 2 / (3 E) of an ellipse is 4 / (3 pi) for a disc; a strip has pi / 4 of its half width.  E by a fit within 1 %.
double low_ratio(double shorter_m, double longer_m) {
  const double integral = 1.0 + (0.5 * std::numbers::pi - 1.0) * std::pow(shorter_m / longer_m, 1.5);
  return 0.25 * std::numbers::pi * (0.5 * shorter_m) / integral;
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

PanelShapes::PanelShapes(const PanelEdges& edges, std::size_t num_planes, std::size_t num_edges) : begin_(num_planes + 1, 0) {
  std::vector<std::size_t> members;
  for (std::uint32_t plane = 0; plane < num_planes; ++plane) {
    begin_[plane] = shapes_.size();
    const std::span<const PanelEdge> sides = edges.of(plane);
    if (sides.size() > kMostSides) continue;
    std::vector<std::uint8_t> done(sides.size(), 0);
    for (std::size_t first = 0; first < sides.size(); ++first) {
      if (done[first] != 0) continue;
      members.assign(1, first);
      done[first] = 1;
      for (std::size_t next = 0; next < members.size(); ++next)
        for (std::size_t i = first + 1; i < sides.size(); ++i) {
          if (done[i] != 0 || glm::dot(sides[i].normal, sides[first].normal) < 0.9 || !touch(sides[members[next]], sides[i])) continue;
          done[i] = 1;
          members.push_back(i);
        }
      add(sides, members, plane);
    }
  }
  begin_[num_planes] = shapes_.size();
  if (shapes_.empty()) return;
  panel_of_face_.assign(2 * num_edges, kNone);
  for (std::uint32_t plane = 0; plane < num_planes; ++plane)
    for (const PanelEdge& side : edges.of(plane)) {
      const glm::dvec3 inside = side.start + 0.5 * side.length_m * side.along - 1e-3 * side.outward;
      if (const PanelShape* const shape = find(plane, inside, inside + side.normal); shape != nullptr)
        panel_of_face_[2 * side.edge + (side.is_first_face ? 0 : 1)] = static_cast<std::uint32_t>(shape - shapes_.data());
    }
}

void PanelShapes::add(std::span<const PanelEdge> sides, std::span<const std::size_t> members, std::uint32_t plane) {
  if (members.size() < 4) return;
  const PanelEdge* longest = &sides[members[0]];
  for (const std::size_t i : members)
    if (sides[i].length_m > longest->length_m) longest = &sides[i];
  PanelShape shape;
  shape.plane = plane;
  shape.normal = longest->normal;
  shape.axis = {longest->along, glm::normalize(glm::cross(longest->normal, longest->along))};
  const glm::dvec3 origin = longest->start;
  // Of the four sides, along each axis and against it: where they are in the mean, and their length together.
  std::array<std::array<double, 2>, 2> at_m{}, length_m{};
  double widest_other_m = 0;
  bool is_rim = true;
  for (const std::size_t i : members) {
    const PanelEdge& side = sides[i];
    bool known = false;
    for (std::size_t a = 0; a < 2; ++a) {
      const double outward = glm::dot(side.outward, shape.axis[a]);
      if (std::abs(outward) < kLeastAlong) continue;
      known = true;
      const std::size_t end = outward > 0 ? 1 : 0;
      at_m[a][end] += side.length_m * glm::dot(side.start + 0.5 * side.length_m * side.along - origin, shape.axis[a]);
      length_m[a][end] += side.length_m;
    }
    if (!known) return;
    is_rim = is_rim && side.exterior_rad > kSheetRad;
    widest_other_m = std::max(widest_other_m, side.other_width_m);
  }
  shape.centre = origin;
  for (std::size_t a = 0; a < 2; ++a) {
    for (std::size_t end = 0; end < 2; ++end) {
      if (!(length_m[a][end] > 0)) return;
      at_m[a][end] /= length_m[a][end];
    }
    shape.half_side_m[a] = 0.5 * (at_m[a][1] - at_m[a][0]);
    shape.centre += 0.5 * (at_m[a][1] + at_m[a][0]) * shape.axis[a];
  }
  const double shorter = 2.0 * std::min(shape.half_side_m[0], shape.half_side_m[1]),
               longer = 2.0 * std::max(shape.half_side_m[0], shape.half_side_m[1]);
  if (!(shorter >= kLeastPanelM) || shorter > kWideFaceM) return;  // a hole has sides below 0
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t end = 0; end < 2; ++end)
      if (length_m[a][end] < kLeastCovered * 2.0 * shape.half_side_m[1 - a]) return;
  shape.is_sheet = is_rim || widest_other_m < kSheetFraction * shorter;
  shape.low_ratio_m = low_ratio(shorter, longer);
  shapes_.push_back(shape);
}

const PanelShape* PanelShapes::find(std::uint32_t plane, glm::dvec3 point, glm::dvec3 from) const {
  for (std::size_t i = begin_[plane]; i < begin_[plane + 1]; ++i)
    if (shapes_[i].holds(point) && glm::dot(shapes_[i].normal, from - shapes_[i].centre) > 0) return &shapes_[i];
  return nullptr;
}

std::vector<std::uint32_t> PanelShapes::largest_from(glm::dvec3 source, std::size_t most) const {
  std::vector<std::pair<double, std::uint32_t>> seen;  // by the angle that they fill, about
  for (std::uint32_t i = 0; i < shapes_.size(); ++i) {
    if (!shapes_[i].faces(source)) continue;
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
