// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/mesh_repair.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include "sim/base/errors.h"

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

/// Float coordinates in double: collinear points give about 1e-16 of the longest edge squared.  A needle is kept while it is a
/// thousand roundings thicker than that: dropping it would open a crack between its neighbours.
bool has_area(glm::dvec3 a, glm::dvec3 b, glm::dvec3 c) {
  const double longest2 = std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)});
  return glm::length(glm::cross(b - a, c - a)) > 1e-13 * longest2;
}

/// Kept vertices whose tolerances lie within a factor of two, by cells twice as wide as the largest of them: everything within one
/// tolerance lies in the 2 x 2 x 2 cells around the nearest cell corner.
class VertexGrid {
 public:
  explicit VertexGrid(double cell_m) : cell_m_(cell_m) {}

  void insert(glm::vec3 vertex, std::uint32_t index) {
    const auto near = nearest_cells(vertex);
    kept_.insert({{near[0][0], near[1][0], near[2][0]}, index});
  }
  template <class Visit>
  void visit_near(glm::vec3 vertex, Visit visit) const {
    const auto near = nearest_cells(vertex);
    for (unsigned corner = 0; corner < 8; ++corner) {
      const auto [begin, end] = kept_.equal_range({near[0][corner & 1u], near[1][corner >> 1 & 1u], near[2][corner >> 2]});
      for (auto it = begin; it != end; ++it) visit(it->second);
    }
  }

 private:
  /// Per axis the cell of the vertex and its nearer neighbour.
  [[nodiscard]] std::array<std::array<std::int64_t, 2>, 3> nearest_cells(glm::vec3 vertex) const {
    std::array<std::array<std::int64_t, 2>, 3> near;
    for (int axis = 0; axis < 3; ++axis) {
      const double position = vertex[axis] / cell_m_, cell = std::floor(position);
      near[static_cast<std::size_t>(axis)] = {static_cast<std::int64_t>(cell),
                                              static_cast<std::int64_t>(position - cell < 0.5 ? cell - 1 : cell + 1)};
    }
    return near;
  }

  double cell_m_;
  std::unordered_multimap<Cell, std::uint32_t, HashWords> kept_;
};

std::vector<std::uint32_t> join_equal_positions(std::span<const glm::vec3> vertices) {
  std::vector<std::uint32_t> first(vertices.size());
  std::unordered_map<std::array<std::uint32_t, 3>, std::uint32_t, HashWords> kept;
  kept.reserve(vertices.size());
  const auto bits = [](float value) { return std::bit_cast<std::uint32_t>(value == 0 ? 0.f : value); };  // 0 and -0 are one position
  for (std::uint32_t i = 0; i < vertices.size(); ++i)
    first[i] = kept.try_emplace({bits(vertices[i].x), bits(vertices[i].y), bits(vertices[i].z)}, i).first->second;
  return first;
}

/// Per vertex: 1e-6 of the diagonal, but never more than a tenth of the longest edge of a triangle there.  One wall of a thousand
/// kilometres must not melt the chairs.
std::vector<float> weld_tolerances(const TriangleMesh& mesh) {
  glm::vec3 lower(std::numeric_limits<float>::infinity()), upper(-lower);
  const auto visit_with_area = [&](auto visit) {
    for (const glm::uvec3 t : mesh.triangles) {
      const glm::dvec3 a = mesh.vertices[t.x], b = mesh.vertices[t.y], c = mesh.vertices[t.z];
      if (has_area(a, b, c)) visit(t, std::sqrt(std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)})));
    }
  };
  visit_with_area([&](glm::uvec3 t, double) {
    for (int corner = 0; corner < 3; ++corner) {
      lower = glm::min(lower, mesh.vertices[t[corner]]);
      upper = glm::max(upper, mesh.vertices[t[corner]]);
    }
  });
  const double diagonal_m = lower.x <= upper.x ? glm::length(glm::dvec3(upper) - glm::dvec3(lower)) : 0;
  std::vector<float> tolerance_m(mesh.vertices.size(), static_cast<float>(1e-6 * diagonal_m));
  visit_with_area([&](glm::uvec3 t, double longest_m) {
    for (int corner = 0; corner < 3; ++corner) {
      float& tolerance = tolerance_m[t[corner]];
      tolerance = std::min(tolerance, static_cast<float>(0.1 * longest_m));
    }
  });
  return tolerance_m;
}

}  // namespace

std::vector<std::uint32_t> weld_map(std::span<const glm::vec3> vertices, std::span<const float> tolerance_m) {
  EARSHOT_EXPECT(vertices.size() == tolerance_m.size());
  float largest = 0, widest_m = 0;
  for (const glm::vec3 vertex : vertices) largest = std::max({largest, std::fabs(vertex.x), std::fabs(vertex.y), std::fabs(vertex.z)});
  for (const float tolerance : tolerance_m) widest_m = std::max(widest_m, tolerance);
  if (!(widest_m > 0)) return join_equal_positions(vertices);

  // Vertices of like tolerance share a grid.  Tolerances a million times finer than the widest share the last one.
  constexpr int finest = 20;
  const auto level_of = [&](float tolerance) {
    return tolerance > 0 ? std::clamp(std::ilogb(widest_m) - std::ilogb(tolerance), 0, finest) : finest;
  };
  std::array<float, finest + 1> widest_of_level{};
  for (const float tolerance : tolerance_m) {
    float& widest = widest_of_level[static_cast<std::size_t>(level_of(tolerance))];
    widest = std::max(widest, tolerance);
  }
  // No cell so small that the number of a far one overflows.
  std::array<std::optional<VertexGrid>, finest + 1> grids;
  const auto cell_m = [&](std::size_t level) { return std::max(2.0 * widest_of_level[level], 0x1p-50 * largest); };

  std::vector<std::uint32_t> first(vertices.size());
  for (std::uint32_t i = 0; i < vertices.size(); ++i) {
    first[i] = i;
    for (const auto& grid : grids) {
      if (!grid) continue;
      grid->visit_near(vertices[i], [&](std::uint32_t other) {
        const glm::dvec3 apart = glm::dvec3(vertices[other]) - glm::dvec3(vertices[i]);
        if (glm::length(apart) <= std::min(tolerance_m[i], tolerance_m[other])) first[i] = std::min(first[i], other);
      });
    }
    if (first[i] != i) continue;
    const auto level = static_cast<std::size_t>(level_of(tolerance_m[i]));
    if (!grids[level]) grids[level].emplace(cell_m(level));
    grids[level]->insert(vertices[i], i);
  }
  return first;
}

std::vector<std::uint32_t> weld_map(std::span<const glm::vec3> vertices, float tolerance_m) {
  return weld_map(vertices, std::vector<float>(vertices.size(), tolerance_m));
}

void repair_mesh(TriangleMesh& mesh, ImportReport& report) {
  const std::vector<std::uint32_t> first = weld_map(mesh.vertices, weld_tolerances(mesh));

  TriangleMesh repaired;
  repaired.material_names = std::move(mesh.material_names);
  repaired.object_names = std::move(mesh.object_names);
  repaired.origin_m = mesh.origin_m;
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
