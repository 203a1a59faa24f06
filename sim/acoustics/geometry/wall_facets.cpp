// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/wall_facets.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <numeric>

#include "sim/acoustics/geometry/exact_plane.h"
#include "sim/acoustics/geometry/mesh_sides.h"

namespace earshot {
namespace {

constexpr double kGapM = 0.05;    // between furniture and what it stands at
constexpr double kInsetM = 0.02;  // of rays at a side
constexpr double kLiftM = 0.005;  // of rays above a facet
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kSolidEdge = 2.0 / 3.0;

double area_of(const TriangleMesh& mesh, std::uint32_t triangle) {
  const glm::uvec3 corner = mesh.triangles[triangle];
  const glm::dvec3 a(mesh.vertices[corner.x]);
  return 0.5 * glm::length(glm::cross(glm::dvec3(mesh.vertices[corner.y]) - a, glm::dvec3(mesh.vertices[corner.z]) - a));
}

/// The smallest rectangle along a side of the largest triangle.
WallFacet rectangle_about(const TriangleMesh& mesh, glm::dvec3 normal, std::span<const std::uint32_t> triangles) {
  const std::uint32_t largest = *std::max_element(triangles.begin(), triangles.end(),
                                                  [&](std::uint32_t a, std::uint32_t b) { return area_of(mesh, a) < area_of(mesh, b); });
  WallFacet best;
  double least_m2 = kInfinity;
  for (int side = 0; side < 3; ++side) {
    const glm::uvec3 corner = mesh.triangles[largest];
    glm::dvec3 along = glm::dvec3(mesh.vertices[corner[(side + 1) % 3]]) - glm::dvec3(mesh.vertices[corner[side]]);
    along -= glm::dot(along, normal) * normal;
    if (!(glm::length(along) > 1e-6)) continue;
    WallFacet facet;
    facet.normal = normal;
    facet.axis[0] = glm::normalize(along);
    facet.axis[1] = glm::cross(normal, facet.axis[0]);
    facet.lower_m.fill(kInfinity), facet.upper_m.fill(-kInfinity);
    for (const std::uint32_t triangle : triangles)
      for (int i = 0; i < 3; ++i)
        for (std::size_t a = 0; a < 2; ++a) {
          const double at = glm::dot(facet.axis[a], glm::dvec3(mesh.vertices[mesh.triangles[triangle][i]]));
          facet.lower_m[a] = std::min(facet.lower_m[a], at), facet.upper_m[a] = std::max(facet.upper_m[a], at);
        }
    const double rectangle_m2 = (facet.upper_m[0] - facet.lower_m[0]) * (facet.upper_m[1] - facet.lower_m[1]);
    if (rectangle_m2 < least_m2) least_m2 = rectangle_m2, best = facet;
  }
  for (const std::uint32_t triangle : triangles) best.area_m2 += area_of(mesh, triangle);
  return best;
}

/// p: of the side.  out: in the plane, away from the facet.  up: away from the face that is looked at.
WallFacet::Side side_at(const EmbreeScene& rays, glm::dvec3 p, glm::dvec3 out, glm::dvec3 up, double inset_m, double depth_m) {
  const auto hits = [&](glm::dvec3 from, glm::dvec3 direction, double length_m) {
    return rays.intersect(glm::vec3(from), glm::vec3(direction), static_cast<float>(length_m)).valid();
  };
  const double lift_m = depth_m + kLiftM;
  if (hits(p - inset_m * out + lift_m * up, out, inset_m + kGapM)) return WallFacet::Side::joined;
  if (hits(p + kInsetM * out + lift_m * up, -up, 2.0 * lift_m + kInsetM)) return WallFacet::Side::endless;
  if (hits(p + kInsetM * out - (depth_m + kGapM) * up, -out, 2.0 * kInsetM)) return WallFacet::Side::solid;
  return WallFacet::Side::sheet;
}

/// Two places of each side, of which that counts where more goes on.
void look_at_sides(const EmbreeScene& rays, double offset_m, double depth_m, WallFacet& facet) {
  for (std::size_t facing = 0; facing < 2; ++facing)
    for (std::size_t a = 0; a < 2; ++a)
      for (std::size_t end = 0; end < 2; ++end) {
        const std::size_t b = 1 - a;
        const double at = end == 0 ? facet.lower_m[a] : facet.upper_m[a], length_m = facet.upper_m[b] - facet.lower_m[b],
                     inset_m = std::min(kInsetM, 0.1 * (facet.upper_m[a] - facet.lower_m[a]));
        WallFacet::Side& side = facet.side[facing][a][end];
        for (const double fraction : {0.35, 0.65}) {
          const glm::dvec3 p = offset_m * facet.normal + at * facet.axis[a] + (facet.lower_m[b] + fraction * length_m) * facet.axis[b];
          side = std::max(side, side_at(rays, p, end == 0 ? -facet.axis[a] : facet.axis[a], facing == 0 ? facet.normal : -facet.normal,
                                        inset_m, depth_m));
        }
      }
}

}  // namespace

WallFacet::View WallFacet::view(glm::dvec3 point, bool along_normal) const {
  View view;
  for (std::size_t a = 0; a < 2; ++a) {
    const auto& sides = side[along_normal ? 0 : 1][a];
    const double length_m = upper_m[a] - lower_m[a], at = std::clamp(glm::dot(axis[a], point), lower_m[a], upper_m[a]);
    const std::array<double, 2> to_side_m = {at - lower_m[a], upper_m[a] - at};
    view.length_m[a] = length_m;
    for (std::size_t end = 0; end < 2; ++end) {
      double distance_m = to_side_m[end];
      Side shown = sides[end];
      if (shown == Side::joined) {
        shown = sides[1 - end];  // mirrored there
        distance_m += length_m;
        view.length_m[a] = 2.0 * length_m;
      }
      const bool is_free = shown == Side::sheet || shown == Side::solid;
      view.to_side_m[a][end] = is_free ? distance_m : kInfinity;
      view.weight[a][end] = shown == Side::solid ? kSolidEdge : 1.0;
      view.ends = view.ends || is_free;
    }
    if (view.to_side_m[a][0] == kInfinity || view.to_side_m[a][1] == kInfinity) view.length_m[a] = kInfinity;
  }
  return view;
}

bool WallFacet::reaches(glm::dvec3 point) const {
  for (std::size_t a = 0; a < 2; ++a) {
    const double at = glm::dot(axis[a], point);
    const auto goes_on = [&](std::size_t end) { return side[0][a][end] == Side::endless || side[1][a][end] == Side::endless; };
    if ((at < lower_m[a] - kGapM && !goes_on(0)) || (at > upper_m[a] + kGapM && !goes_on(1))) return false;
  }
  return true;
}

WallFacets::WallFacets(const Scene& scene, std::span<const MirrorPlane> planes, std::span<const std::uint32_t> plane_of_triangle,
                       const FoldedPlanes& folds, double least_m2, std::size_t most) {
  const TriangleMesh& mesh = scene.mesh();
  const auto count = static_cast<std::uint32_t>(mesh.triangles.size());
  std::vector<std::uint32_t> parent(count);
  std::iota(parent.begin(), parent.end(), 0u);
  const auto first_of = [&](std::uint32_t triangle) {
    while (parent[triangle] != triangle) triangle = parent[triangle] = parent[parent[triangle]];
    return triangle;
  };
  for_each_joint(sorted_sides(mesh), [&](std::span<const MeshSide> sides) {
    for (std::size_t i = 0; i < sides.size(); ++i)
      for (std::size_t j = i + 1; j < std::min(sides.size(), i + 4); ++j) {
        if (plane_of_triangle[sides[i].triangle] != plane_of_triangle[sides[j].triangle]) continue;
        const std::uint32_t a = first_of(sides[i].triangle), b = first_of(sides[j].triangle);
        parent[std::max(a, b)] = std::min(a, b);
      }
  });
  struct Part {
    double area_m2 = 0;
    std::uint32_t fold = kNone;  // or a connected part of a plane
    std::vector<std::uint32_t> triangles;
  };
  std::vector<double> area_m2(count, 0.0);  // by the first triangle
  for (std::uint32_t triangle = 0; triangle < count; ++triangle) area_m2[first_of(triangle)] += area_of(mesh, triangle);
  std::vector<Part> parts;
  std::vector<std::uint32_t> part_of(count, kNone);
  for (std::uint32_t triangle = 0; triangle < count; ++triangle) {
    const std::uint32_t first = first_of(triangle);
    if (!(area_m2[first] >= least_m2)) continue;
    if (part_of[first] == kNone) part_of[first] = static_cast<std::uint32_t>(parts.size()), parts.push_back({area_m2[first], kNone, {}});
    parts[part_of[first]].triangles.push_back(triangle);
  }
  const std::size_t num_flat = parts.size();
  for (std::uint32_t fold = 0; fold < folds.planes.size(); ++fold) parts.push_back({double{folds.planes[fold].area_m2}, fold, {}});
  if (!folds.planes.empty())
    for (std::uint32_t triangle = 0; triangle < count; ++triangle)
      if (folds.fold_of_triangle[triangle] < folds.planes.size())
        parts[num_flat + folds.fold_of_triangle[triangle]].triangles.push_back(triangle);
  std::vector<std::size_t> order(parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return parts[a].area_m2 > parts[b].area_m2; });
  of_triangle_.assign(count, kNone);
  of_fold_.assign(folds.planes.size(), kNone);
  for (const std::size_t index : order) {
    const Part& part = parts[index];
    if (facets_.size() >= most || part.area_m2 < least_m2 || part.triangles.empty()) continue;
    const bool is_fold = part.fold != kNone;
    const ExactPlane plane(is_fold ? folds.planes[part.fold] : planes[plane_of_triangle[part.triangles.front()]]);
    const auto facet = static_cast<std::uint32_t>(facets_.size());
    facets_.push_back(rectangle_about(mesh, plane.normal, part.triangles));
    look_at_sides(scene.rays(), plane.offset_m, is_fold ? double{folds.depth_m[part.fold]} : 0.0, facets_.back());
    if (is_fold) {
      of_fold_[part.fold] = facet;
    } else {
      for (const std::uint32_t triangle : part.triangles) of_triangle_[triangle] = facet;
    }
  }
}

}  // namespace earshot
