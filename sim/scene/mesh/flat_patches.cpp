// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/flat_patches.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numeric>
#include <span>

#include "sim/base/errors.h"
#include "sim/scene/mesh/patch_collapse.h"

namespace earshot {
namespace {

constexpr std::uint32_t kNoTriangle = 0xFFFFFFFFu;
/// Of the diagonal, and of the root of a triangle's area.
constexpr double kFlatOfDiagonal = 1e-6, kFlatOfTriangle = 1e-3;
/// Facing of neighbours in a patch: small triangles may lean by their rounding.
constexpr double kSameFacing = 0.999;

struct Facet {
  glm::dvec3 normal{0};  ///< unit; zero without area
  double area_m2 = 0;
};

class PatchFinder {
 public:
  explicit PatchFinder(const TriangleMesh& mesh) : mesh_(mesh), patch_(mesh.triangles.size(), kNoTriangle) {
    const Bounds bounds = bounds_of(mesh);
    if (!mesh.triangles.empty()) flat_m_ = kFlatOfDiagonal * glm::length(glm::dvec3(bounds.upper) - glm::dvec3(bounds.lower));
    find_neighbours();
  }

  /// The patch of `first`, which no patch has yet: itself first.
  std::span<const std::uint32_t> grow(std::uint32_t first) {
    members_.assign(1, first);
    patch_[first] = first;
    const Facet seed = facet(first);
    if (seed.area_m2 == 0) return members_;
    const glm::dvec3 normal = seed.normal, origin = vertex(mesh_.triangles[first].x);
    const double most_m = flatness(seed);
    for (std::size_t next = 0; next < members_.size(); ++next) {
      for (std::size_t side = 0; side < 3; ++side) {
        const std::uint32_t other = neighbours_[3 * std::size_t{members_[next]} + side];
        if (other == kNoTriangle || patch_[other] != kNoTriangle) continue;
        const Facet of_other = facet(other);
        if (glm::dot(of_other.normal, normal) < kSameFacing) continue;
        const double limit_m = std::min(most_m, flatness(of_other));
        const glm::uvec3 corner = mesh_.triangles[other];
        const bool flat = std::fabs(glm::dot(vertex(corner.x) - origin, normal)) <= limit_m &&
                          std::fabs(glm::dot(vertex(corner.y) - origin, normal)) <= limit_m &&
                          std::fabs(glm::dot(vertex(corner.z) - origin, normal)) <= limit_m;
        if (!flat) continue;
        patch_[other] = first;
        members_.push_back(other);
      }
    }
    return members_;
  }

  [[nodiscard]] bool is_taken(std::uint32_t triangle) const { return patch_[triangle] != kNoTriangle; }
  [[nodiscard]] Facet facet(std::uint32_t triangle) const {
    const glm::uvec3 corner = mesh_.triangles[triangle];
    const glm::dvec3 a = vertex(corner.x), n = glm::cross(vertex(corner.y) - a, vertex(corner.z) - a);
    const double length = glm::length(n);
    return length > 0 && std::isfinite(length) ? Facet{n / length, 0.5 * length} : Facet{};
  }
  /// Whether the patch of a triangle ends at this side.
  [[nodiscard]] bool is_border(std::uint32_t triangle, int side) const {
    const std::uint32_t other = neighbours_[3 * std::size_t{triangle} + static_cast<std::size_t>(side)];
    return other == kNoTriangle || patch_[other] != patch_[triangle];
  }

 private:
  [[nodiscard]] glm::dvec3 vertex(std::uint32_t index) const { return mesh_.vertices[index]; }
  [[nodiscard]] double flatness(const Facet& facet) const { return std::min(flat_m_, kFlatOfTriangle * std::sqrt(facet.area_m2)); }

  /// Across sides that just two triangles share, one in each direction, of the same material and object.
  void find_neighbours() {
    // Sides, as 3 * triangle + side, by their lower vertex: the others that it may be shared with are few.
    const std::size_t num_sides = 3 * mesh_.triangles.size();
    EARSHOT_EXPECT(num_sides < kNoTriangle);
    const auto start = [&](std::uint32_t side) { return mesh_.triangles[side / 3][static_cast<int>(side % 3)]; };
    const auto end_of = [&](std::uint32_t side) { return mesh_.triangles[side / 3][static_cast<int>((side + 1) % 3)]; };
    std::vector<std::uint32_t> first_side_of_vertex(mesh_.vertices.size() + 1, 0), sides(num_sides);
    for (std::uint32_t side = 0; side < num_sides; ++side) ++first_side_of_vertex[std::min(start(side), end_of(side)) + 1];
    std::partial_sum(first_side_of_vertex.begin(), first_side_of_vertex.end(), first_side_of_vertex.begin());
    std::vector<std::uint32_t> next(first_side_of_vertex.begin(), first_side_of_vertex.end() - 1);
    for (std::uint32_t side = 0; side < num_sides; ++side) sides[next[std::min(start(side), end_of(side))]++] = side;

    neighbours_.assign(num_sides, kNoTriangle);
    for (std::size_t vertex = 0; vertex + 1 < first_side_of_vertex.size(); ++vertex) {
      const auto group =
          std::span(sides).subspan(first_side_of_vertex[vertex], first_side_of_vertex[vertex + 1] - first_side_of_vertex[vertex]);
      const auto far = [&](std::uint32_t side) { return std::max(start(side), end_of(side)); };
      std::sort(group.begin(), group.end(), [&](std::uint32_t a, std::uint32_t b) { return far(a) != far(b) ? far(a) < far(b) : a < b; });
      for (std::size_t begin = 0, end; begin < group.size(); begin = end) {
        for (end = begin + 1; end < group.size() && far(group[end]) == far(group[begin]);) ++end;
        if (end - begin == 2 && start(group[begin]) == end_of(group[begin + 1])) join(group[begin], group[begin + 1]);
      }
    }
  }

  void join(std::uint32_t side, std::uint32_t other) {
    const std::uint32_t a = side / 3, b = other / 3;
    if (mesh_.triangle_material[a] != mesh_.triangle_material[b] || mesh_.triangle_object[a] != mesh_.triangle_object[b]) return;
    neighbours_[side] = b;
    neighbours_[other] = a;
  }

  const TriangleMesh& mesh_;
  double flat_m_ = 0;
  std::vector<std::uint32_t> neighbours_;  ///< [triangle][side]
  std::vector<std::uint32_t> patch_;       ///< first triangle of the patch
  std::vector<std::uint32_t> members_;
};

/// New triangles of a patch; empty if it stays as it is.
std::vector<glm::uvec3> merge(const TriangleMesh& mesh, const PatchFinder& finder, std::span<const std::uint32_t> members,
                              glm::dvec3 normal) {
  std::vector<std::uint32_t> used;
  used.reserve(3 * members.size());
  for (const std::uint32_t member : members)
    for (int corner = 0; corner < 3; ++corner) used.push_back(mesh.triangles[member][corner]);
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  const auto local = [&](std::uint32_t vertex) {
    return static_cast<std::uint32_t>(std::lower_bound(used.begin(), used.end(), vertex) - used.begin());
  };
  FlatPatch patch;
  patch.is_border.resize(used.size());
  for (const std::uint32_t member : members)
    for (int side = 0; side < 3; ++side)
      if (finder.is_border(member, side))
        for (const int corner : {side, (side + 1) % 3}) patch.is_border[local(mesh.triangles[member][corner])] = true;
  if (std::all_of(patch.is_border.begin(), patch.is_border.end(), [](bool border) { return border; })) return {};

  const glm::dvec3 helper = std::fabs(normal.x) < 0.7 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 u = glm::normalize(glm::cross(helper, normal)), v = glm::cross(normal, u), origin = mesh.vertices[used[0]];
  for (const std::uint32_t vertex : used) {
    const glm::dvec3 from = glm::dvec3(mesh.vertices[vertex]) - origin;
    patch.vertices.emplace_back(glm::dot(from, u), glm::dot(from, v));
  }
  for (const std::uint32_t member : members) {
    const glm::uvec3 corner = mesh.triangles[member];
    patch.triangles.push_back({local(corner.x), local(corner.y), local(corner.z)});
  }
  collapse_inner_vertices(patch);
  if (patch.triangles.size() == members.size()) return {};
  std::vector<glm::uvec3> merged;
  for (const auto& t : patch.triangles) merged.emplace_back(used[t[0]], used[t[1]], used[t[2]]);
  return merged;
}

}  // namespace

RaySurface merge_flat_patches(const TriangleMesh& mesh) {
  constexpr std::size_t fewest = 3;  // triangles round an inner vertex
  RaySurface surface;
  surface.triangles.reserve(mesh.triangles.size());
  surface.stands_for.reserve(mesh.triangles.size());
  PatchFinder finder(mesh);
  std::vector<bool> replaced(mesh.triangles.size(), false);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!finder.is_taken(t)) {
      const std::span<const std::uint32_t> members = finder.grow(t);
      std::vector<glm::uvec3> merged;
      std::uint32_t largest = t;  // its plane is known best
      if (members.size() >= fewest) {
        double largest_m2 = 0;
        for (const std::uint32_t member : members)
          if (const double area_m2 = finder.facet(member).area_m2; area_m2 > largest_m2) largest_m2 = area_m2, largest = member;
        merged = merge(mesh, finder, members, finder.facet(largest).normal);
      }
      surface.triangles.insert(surface.triangles.end(), merged.begin(), merged.end());
      surface.stands_for.resize(surface.triangles.size(), largest);
      if (!merged.empty())
        for (const std::uint32_t member : members) replaced[member] = true;
    }
    if (replaced[t]) continue;
    surface.triangles.push_back(mesh.triangles[t]);
    surface.stands_for.push_back(t);
  }
  return surface;
}

}  // namespace earshot
