// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/geometry/mirror_planes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <numeric>
#include <unordered_map>

namespace earshot {
namespace {

constexpr double kNormalTolerance = 0.5 * 3.14159265358979323846 / 180.0;  // radians, and the chord at this size
constexpr double kCell = 2.0 * kNormalTolerance;                           // edge of a cell of the normal's grid

/// Triangles in double, relative to the centre of the scene: offsets of a scene far from the origin keep their digits.
struct Facet {
  glm::dvec3 normal{0}, centroid{0};
  double area = 0;
};

Facet facet_of(const TriangleMesh& mesh, std::size_t triangle, glm::dvec3 centre) {
  const glm::uvec3 index = mesh.triangles[triangle];
  const glm::dvec3 a = glm::dvec3(mesh.vertices[index.x]) - centre, b = glm::dvec3(mesh.vertices[index.y]) - centre,
                   c = glm::dvec3(mesh.vertices[index.z]) - centre;
  const glm::dvec3 cross = glm::cross(b - a, c - a);
  const double length = glm::length(cross);
  // A triangle without area reflects nothing; any unit normal will do.
  return {.normal = length > 0 ? cross / length : glm::dvec3(0, 1, 0), .centroid = (a + b + c) / 3.0, .area = 0.5 * length};
}

using Cell = std::array<int, 3>;
struct CellHash {
  std::size_t operator()(const Cell& cell) const {
    std::uint64_t h = 0xCBF29CE484222325u;
    for (const int value : cell) h = (h ^ static_cast<std::uint32_t>(value)) * 0x9E3779B97F4A7C15u;
    return static_cast<std::size_t>(h ^ (h >> 32));
  }
};

/// Planes found so far, by the cell of their normal, then by offset.
class PlaneIndex {
 public:
  explicit PlaneIndex(double offset_tolerance_m) : offset_tolerance_m_(offset_tolerance_m) {}

  void insert(glm::dvec3 normal, double offset_m, std::uint32_t plane) { cells_[cell_of(normal)].emplace(offset_m, Entry{normal, plane}); }

  /// The plane nearest to the facet among those within tolerance; none: 0xFFFFFFFF.
  [[nodiscard]] std::uint32_t find(const Facet& facet) const {
    Best best;
    search(facet, facet.normal, best);
    search(facet, -facet.normal, best);
    return best.plane;
  }

 private:
  struct Entry {
    glm::dvec3 normal;
    std::uint32_t plane;
  };
  struct Best {
    double distance_m = std::numeric_limits<double>::infinity();
    std::uint32_t plane = 0xFFFFFFFFu;
  };

  static Cell cell_of(glm::dvec3 normal) {
    return {static_cast<int>(std::floor(normal.x / kCell)), static_cast<int>(std::floor(normal.y / kCell)),
            static_cast<int>(std::floor(normal.z / kCell))};
  }

  void search(const Facet& facet, glm::dvec3 normal, Best& best) const {
    const Cell low = cell_of(normal - kNormalTolerance), high = cell_of(normal + kNormalTolerance);
    const double offset_m = glm::dot(normal, facet.centroid);
    // The plane's own normal may differ by the tolerance, which moves the offset by that fraction of the distance from the centre.
    const double slack_m = offset_tolerance_m_ + kNormalTolerance * glm::length(facet.centroid);
    for (int x = low[0]; x <= high[0]; ++x)
      for (int y = low[1]; y <= high[1]; ++y)
        for (int z = low[2]; z <= high[2]; ++z) {
          const auto cell = cells_.find({x, y, z});
          if (cell == cells_.end()) continue;
          for (auto entry = cell->second.lower_bound(offset_m - slack_m); entry != cell->second.end() && entry->first <= offset_m + slack_m;
               ++entry) {
            if (glm::length(entry->second.normal - normal) > kNormalTolerance) continue;
            const double distance_m = std::abs(glm::dot(entry->second.normal, facet.centroid) - entry->first);
            if (distance_m > offset_tolerance_m_) continue;
            if (distance_m < best.distance_m || (distance_m == best.distance_m && entry->second.plane < best.plane)) {
              best = {distance_m, entry->second.plane};
            }
          }
        }
  }

  double offset_tolerance_m_;
  std::unordered_map<Cell, std::multimap<double, Entry>, CellHash> cells_;
};

/// Large triangles first: their normals are the best known, and small neighbours join them.
std::vector<std::uint32_t> order_by_area(const std::vector<Facet>& facets) {
  std::vector<std::uint32_t> order(facets.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return facets[a].area > facets[b].area; });
  return order;
}

/// The plane of a facet, without any triangle yet.
MirrorPlane empty_plane(const Facet& facet, glm::dvec3 centre) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  return {.normal = glm::vec3(facet.normal),
          .offset_m = static_cast<float>(glm::dot(facet.normal, facet.centroid + centre)),
          .area_m2 = 0,
          .material = 0,
          .bounds = {glm::vec3(infinity), glm::vec3(-infinity)}};
}

void extend_bounds(Bounds& bounds, const TriangleMesh& mesh, std::uint32_t triangle) {
  for (int corner = 0; corner < 3; ++corner) {
    const glm::vec3 vertex = mesh.vertices[mesh.triangles[triangle][corner]];
    bounds.lower = glm::min(bounds.lower, vertex);
    bounds.upper = glm::max(bounds.upper, vertex);
  }
}

using AreaOfMaterial = std::map<std::pair<std::uint32_t, std::uint32_t>, double>;  // (plane, slot) -> m2

/// Each plane gets the material that covers most of it.
void choose_materials(const AreaOfMaterial& area_of_material, std::vector<MirrorPlane>& planes) {
  std::vector<double> largest(planes.size(), -1);
  for (const auto& [key, area_m2] : area_of_material) {
    if (area_m2 > largest[key.first]) {
      largest[key.first] = area_m2;
      planes[key.first].material = key.second;
    }
  }
}

}  // namespace

MirrorPlanes find_mirror_planes(const TriangleMesh& mesh) {
  MirrorPlanes result;
  const std::size_t count = mesh.triangles.size();
  result.plane_of_triangle.resize(count);
  if (count == 0) return result;

  const Bounds bounds = bounds_of(mesh);
  const glm::dvec3 centre = 0.5 * (glm::dvec3(bounds.lower) + glm::dvec3(bounds.upper));
  const double diagonal_m = glm::length(glm::dvec3(bounds.upper) - glm::dvec3(bounds.lower));
  const double tolerance_m = std::min(1e-3 + 1e-5 * diagonal_m, 1e-4 * diagonal_m);
  PlaneIndex index(tolerance_m);

  std::vector<Facet> facets(count);
  for (std::size_t i = 0; i < count; ++i) facets[i] = facet_of(mesh, i, centre);
  AreaOfMaterial area_of_material;
  std::vector<double> area;
  for (const std::uint32_t triangle : order_by_area(facets)) {
    const Facet& facet = facets[triangle];
    std::uint32_t plane = index.find(facet);
    if (plane == 0xFFFFFFFFu) {
      plane = static_cast<std::uint32_t>(result.planes.size());
      index.insert(facet.normal, glm::dot(facet.normal, facet.centroid), plane);
      result.planes.push_back(empty_plane(facet, centre));
      area.push_back(0);
    }
    result.plane_of_triangle[triangle] = plane;
    area[plane] += facet.area;
    extend_bounds(result.planes[plane].bounds, mesh, triangle);
    area_of_material[{plane, mesh.triangle_material[triangle]}] += facet.area;
  }
  choose_materials(area_of_material, result.planes);
  for (std::size_t i = 0; i < area.size(); ++i) {
    MirrorPlane& plane = result.planes[i];
    plane.area_m2 = static_cast<float>(area[i]);
    plane.bounds.lower -= static_cast<float>(tolerance_m);
    plane.bounds.upper += static_cast<float>(tolerance_m);
  }
  return result;
}

}  // namespace earshot
