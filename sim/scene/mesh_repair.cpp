#include "sim/scene/mesh_repair.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <unordered_map>
#include <unordered_set>

namespace earshot {
namespace {

struct Cell {
  std::int64_t x, y, z;
  bool operator==(const Cell&) const = default;
};

struct HashWords {
  static std::size_t mix(std::uint64_t hash, std::uint64_t word) {
    return (hash ^ (word + 0x9E3779B97F4A7C15ull + (hash << 6) + (hash >> 2))) * 0xFF51AFD7ED558CCDull;
  }
  std::size_t operator()(const Cell& cell) const {
    return mix(mix(mix(0, static_cast<std::uint64_t>(cell.x)), static_cast<std::uint64_t>(cell.y)), static_cast<std::uint64_t>(cell.z));
  }
  std::size_t operator()(const std::array<std::uint32_t, 3>& corners) const { return mix(mix(mix(0, corners[0]), corners[1]), corners[2]); }
};

/// Float coordinates in double: what lies on a line comes out near 1e-16 of the longest edge squared.  A needle is kept while it is a
/// thousand roundings thicker than that: dropping it would open a crack between its neighbours.
bool has_area(glm::dvec3 a, glm::dvec3 b, glm::dvec3 c) {
  const double longest2 = std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)});
  return glm::length(glm::cross(b - a, c - a)) > 1e-13 * longest2;
}

}  // namespace

std::vector<std::uint32_t> weld_map(std::span<const glm::vec3> vertices, float tolerance_m) {
  std::vector<std::uint32_t> first(vertices.size());
  // Cells two tolerances wide: everything within one tolerance lies in the 2 x 2 x 2 cells around the nearest cell corner.  Not
  // below the spacing of floats, so that far coordinates do not overflow the cell numbers.
  float largest = 0;
  for (const glm::vec3 vertex : vertices) largest = std::max({largest, std::fabs(vertex.x), std::fabs(vertex.y), std::fabs(vertex.z)});
  const double cell_m = tolerance_m > 0 ? std::max(2.0 * tolerance_m, 0x1p-22 * largest) : 0;
  std::unordered_multimap<Cell, std::uint32_t, HashWords> kept;
  kept.reserve(vertices.size());
  for (std::uint32_t i = 0; i < vertices.size(); ++i) {
    const glm::vec3 vertex = vertices[i];
    first[i] = i;
    std::array<std::array<std::int64_t, 2>, 3> near;
    for (int axis = 0; axis < 3; ++axis) {
      if (cell_m > 0) {
        const double position = vertex[axis] / cell_m;
        const double cell = std::floor(position);
        near[static_cast<std::size_t>(axis)] = {static_cast<std::int64_t>(cell),
                                                static_cast<std::int64_t>(position - cell < 0.5 ? cell - 1 : cell + 1)};
      } else {  // the bits name the cell; 0 and -0 share one
        const float value = vertex[axis] == 0 ? 0.f : vertex[axis];
        const auto bits = std::bit_cast<std::int32_t>(value);
        near[static_cast<std::size_t>(axis)] = {bits, bits};
      }
    }
    for (unsigned corner = 0; corner < (cell_m > 0 ? 8u : 1u); ++corner) {
      const auto [begin, end] = kept.equal_range({near[0][corner & 1u], near[1][corner >> 1 & 1u], near[2][corner >> 2]});
      for (auto it = begin; it != end; ++it) {
        const glm::dvec3 apart = glm::dvec3(vertices[it->second]) - glm::dvec3(vertex);
        if (glm::length(apart) <= tolerance_m) first[i] = std::min(first[i], it->second);
      }
    }
    if (first[i] == i) kept.insert({{near[0][0], near[1][0], near[2][0]}, i});
  }
  return first;
}

void repair_mesh(TriangleMesh& mesh, ImportReport& report) {
  const Bounds bounds = bounds_of(mesh);
  const double diagonal_m = mesh.triangles.empty() ? 0 : glm::length(glm::dvec3(bounds.upper) - glm::dvec3(bounds.lower));
  const std::vector<std::uint32_t> first = weld_map(mesh.vertices, static_cast<float>(1e-6 * diagonal_m));

  TriangleMesh repaired;
  repaired.material_names = std::move(mesh.material_names);
  repaired.object_names = std::move(mesh.object_names);
  constexpr std::uint32_t unused = 0xFFFFFFFFu;
  std::vector<std::uint32_t> new_index(mesh.vertices.size(), unused);
  std::vector<bool> referenced(mesh.vertices.size(), false);
  std::unordered_set<std::array<std::uint32_t, 3>, HashWords> seen;
  seen.reserve(mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    glm::uvec3 corners = mesh.triangles[i];
    for (int c = 0; c < 3; ++c) {
      referenced[corners[c]] = true;
      corners[c] = first[corners[c]];
    }
    if (!has_area(mesh.vertices[corners.x], mesh.vertices[corners.y], mesh.vertices[corners.z])) {
      ++report.degenerate_removed;
      continue;
    }
    std::array<std::uint32_t, 3> key{corners.x, corners.y, corners.z};
    std::sort(key.begin(), key.end());
    if (!seen.insert(key).second) {
      ++report.duplicate_removed;
      continue;
    }
    for (int c = 0; c < 3; ++c) {
      std::uint32_t& index = new_index[corners[c]];
      if (index == unused) {
        index = static_cast<std::uint32_t>(repaired.vertices.size());
        repaired.vertices.push_back(mesh.vertices[corners[c]]);
      }
      corners[c] = index;
    }
    repaired.triangles.push_back(corners);
    repaired.triangle_material.push_back(mesh.triangle_material[i]);
    repaired.triangle_object.push_back(mesh.triangle_object[i]);
  }
  for (std::size_t v = 0; v < first.size(); ++v) report.vertices_welded += referenced[v] && first[v] != v;
  mesh = std::move(repaired);
}

}  // namespace earshot
