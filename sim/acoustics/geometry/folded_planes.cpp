// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/folded_planes.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>

#include "sim/acoustics/geometry/diffraction_edges.h"
#include "sim/acoustics/geometry/mesh_sides.h"

namespace earshot {
namespace {

/// Of the angle by which wedges blunter than kBluntRad turn.
const double kMinCosine = std::cos(kBluntRad - std::numbers::pi);

/// Which triangles hang together across nearly flat joints: the first of each lot stands for it.
class Lots {
 public:
  explicit Lots(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0u); }
  [[nodiscard]] std::uint32_t of(std::uint32_t triangle) {
    while (parent_[triangle] != triangle) triangle = parent_[triangle] = parent_[parent_[triangle]];
    return triangle;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = of(a), b = of(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Unit, from the side into its triangle.
std::optional<glm::dvec3> inward(const TriangleMesh& mesh, const MeshSide& side) {
  const glm::dvec3 start(mesh.vertices[side.low()]), along = glm::dvec3(mesh.vertices[side.high()]) - start;
  glm::dvec3 into = glm::dvec3(mesh.vertices[side.opposite]) - start;
  into -= glm::dot(into, along) / glm::dot(along, along) * along;
  const double height_m = glm::length(into);
  if (!(height_m > 1e-9 * glm::length(along))) return std::nullopt;
  return into / height_m;
}

glm::dvec3 doubled_area(const TriangleMesh& mesh, std::uint32_t triangle) {
  const glm::uvec3 corner = mesh.triangles[triangle];
  const glm::dvec3 a(mesh.vertices[corner.x]);
  return glm::cross(glm::dvec3(mesh.vertices[corner.y]) - a, glm::dvec3(mesh.vertices[corner.z]) - a);
}

struct Fold {
  MirrorPlane plane;
  float depth_m;
  std::uint32_t largest;  ///< mirror plane
};

std::optional<Fold> fold_of(const TriangleMesh& mesh, const MirrorPlanes& mirrors, std::span<const std::uint32_t> triangles,
                            double deepest_m) {
  // The mirror planes come with the largest first.
  std::uint32_t largest = std::numeric_limits<std::uint32_t>::max(), other = 0;
  for (const std::uint32_t triangle : triangles) {
    largest = std::min(largest, mirrors.plane_of_triangle[triangle]);
    other = std::max(other, mirrors.plane_of_triangle[triangle]);
  }
  if (largest == other) return std::nullopt;
  const glm::dvec3 facing(mirrors.planes[largest].normal), origin(mesh.vertices[mesh.triangles[triangles[0]].x]);
  glm::dvec3 sum(0), centroid(0);
  double area = 0;
  for (const std::uint32_t triangle : triangles) {
    const glm::dvec3 triangle_area = doubled_area(mesh, triangle);
    sum += glm::dot(triangle_area, facing) < 0 ? -triangle_area : triangle_area;
    for (int i = 0; i < 3; ++i)
      centroid += glm::length(triangle_area) / 3.0 * (glm::dvec3(mesh.vertices[mesh.triangles[triangle][i]]) - origin);
    area += glm::length(triangle_area);
  }
  if (!(glm::length(sum) > 0)) return std::nullopt;
  const glm::dvec3 normal = glm::normalize(sum);
  constexpr float infinity = std::numeric_limits<float>::infinity();
  Bounds bounds{glm::vec3(infinity), glm::vec3(-infinity)};
  double lowest_m = std::numeric_limits<double>::infinity(), highest_m = -lowest_m;
  for (const std::uint32_t triangle : triangles) {
    const glm::dvec3 triangle_area = doubled_area(mesh, triangle);
    if (std::abs(glm::dot(triangle_area, normal)) < kMinCosine * glm::length(triangle_area)) return std::nullopt;
    for (int i = 0; i < 3; ++i) {
      const glm::vec3 vertex = mesh.vertices[mesh.triangles[triangle][i]];
      const double height_m = glm::dot(normal, glm::dvec3(vertex) - origin);
      lowest_m = std::min(lowest_m, height_m), highest_m = std::max(highest_m, height_m);
      bounds.lower = glm::min(bounds.lower, vertex), bounds.upper = glm::max(bounds.upper, vertex);
    }
  }
  if (!(highest_m - lowest_m < deepest_m)) return std::nullopt;
  const auto depth_m = static_cast<float>(highest_m - lowest_m);
  bounds.lower -= depth_m, bounds.upper += depth_m;
  const double offset_m = glm::dot(normal, origin + centroid / area);
  return Fold{{glm::vec3(normal), static_cast<float>(offset_m), static_cast<float>(0.5 * area), mirrors.planes[largest].material, bounds},
              depth_m,
              largest};
}

}  // namespace

FoldedPlanes find_folded_planes(const TriangleMesh& mesh, const MirrorPlanes& mirrors, double deepest_m) {
  const std::size_t count = mesh.triangles.size();
  Lots lots(count);
  for_each_joint(sorted_sides(mesh), [&](std::span<const MeshSide> sides) {
    if (sides.size() != 2) return;  // where another wall begins the fold ends
    const auto a = inward(mesh, sides[0]), b = inward(mesh, sides[1]);
    if (a && b && glm::dot(*a, *b) < -kMinCosine) lots.join(sides[0].triangle, sides[1].triangle);
  });
  std::vector<std::uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return lots.of(a) < lots.of(b); });

  struct Found {
    Fold fold;
    std::span<const std::uint32_t> triangles;
  };
  std::vector<Found> found;
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    while (end < count && lots.of(order[end]) == lots.of(order[begin])) ++end;
    const auto triangles = std::span<const std::uint32_t>(order).subspan(begin, end - begin);
    if (const auto fold = fold_of(mesh, mirrors, triangles, deepest_m)) found.push_back({*fold, triangles});
  }
  FoldedPlanes result;
  if (found.empty()) return result;
  std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.fold.plane.area_m2 > b.fold.plane.area_m2; });
  result.fold_of_triangle.assign(count, static_cast<std::uint32_t>(found.size()));
  for (const Found& candidate : found) {
    for (const std::uint32_t triangle : candidate.triangles)
      result.fold_of_triangle[triangle] = static_cast<std::uint32_t>(result.planes.size());
    result.planes.push_back(candidate.fold.plane);
    result.depth_m.push_back(candidate.fold.depth_m);
    result.some_plane.push_back(candidate.fold.largest);
  }
  return result;
}

}  // namespace earshot
