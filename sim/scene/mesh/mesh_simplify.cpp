// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/mesh_simplify.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "sim/base/errors.h"
#include "sim/scene/mesh/mesh_repair.h"

namespace earshot {
namespace {

constexpr float least_fraction = 0.01f;  // of deviation_m, below which a part stays as it is

/// Corners of the triangles of one (material, object), three by three.
using Corners = std::vector<std::uint32_t>;

Corners simplify_part(const TriangleMesh& mesh, const Corners& part, float deviation_m) {
  // The library reads every vertex it is given: hand it those of this part only.
  std::vector<std::uint32_t> used(part);
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  std::vector<glm::vec3> vertices;
  vertices.reserve(used.size());
  for (const std::uint32_t vertex : used) vertices.push_back(mesh.vertices[vertex]);
  Corners local(part.size());
  std::transform(part.begin(), part.end(), local.begin(), [&](std::uint32_t vertex) {
    return static_cast<std::uint32_t>(std::lower_bound(used.begin(), used.end(), vertex) - used.begin());
  });

  const float scale_m = meshopt_simplifyScale(&vertices[0].x, vertices.size(), sizeof(glm::vec3));
  if (!(scale_m > 0)) return part;
  Corners result(local.size());
  const std::size_t count = meshopt_simplify(result.data(), local.data(), local.size(), &vertices[0].x, vertices.size(), sizeof(glm::vec3),
                                             0, deviation_m / scale_m, meshopt_SimplifyLockBorder);
  result.resize(count);
  for (std::uint32_t& corner : result) corner = used[corner];
  return result;
}

double deviation_of(const TriangleMesh& mesh, const Corners& before, const Corners& after) {
  constexpr std::size_t most_probes = 512;
  std::vector<std::uint32_t> kept(after), gone(before);
  for (auto* list : {&kept, &gone}) {
    std::sort(list->begin(), list->end());
    list->erase(std::unique(list->begin(), list->end()), list->end());
  }
  std::vector<std::uint32_t> removed;
  std::set_difference(gone.begin(), gone.end(), kept.begin(), kept.end(), std::back_inserter(removed));
  const std::size_t probes = std::min(removed.size(), most_probes);
  if (after.empty() && probes > 0) return std::numeric_limits<double>::infinity();
  double largest_m = 0;
  for (std::size_t i = 0; i < probes; ++i) {
    const glm::dvec3 point = mesh.vertices[removed[i * removed.size() / probes]];
    double nearest_m = std::numeric_limits<double>::infinity();
    for (std::size_t t = 0; t < after.size() && nearest_m > largest_m; t += 3) {
      nearest_m = std::min(nearest_m,
                           distance_to_triangle(point, mesh.vertices[after[t]], mesh.vertices[after[t + 1]], mesh.vertices[after[t + 2]]));
    }
    largest_m = std::max(largest_m, nearest_m);
  }
  return largest_m;
}

}  // namespace

double distance_to_triangle(glm::dvec3 point, glm::dvec3 a, glm::dvec3 b, glm::dvec3 c) {
  const glm::dvec3 ab = b - a, ac = c - a, ap = point - a, bp = point - b, cp = point - c;
  const double d1 = glm::dot(ab, ap), d2 = glm::dot(ac, ap), d3 = glm::dot(ab, bp), d4 = glm::dot(ac, bp);
  const double d5 = glm::dot(ab, cp), d6 = glm::dot(ac, cp);
  if (d1 <= 0 && d2 <= 0) return glm::length(ap);
  if (d3 >= 0 && d4 <= d3) return glm::length(bp);
  if (d6 >= 0 && d5 <= d6) return glm::length(cp);
  const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return glm::length(ap - d1 / (d1 - d3) * ab);
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return glm::length(ap - d2 / (d2 - d6) * ac);
  if (va <= 0 && d4 >= d3 && d5 >= d6) return glm::length(bp - (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b));
  const glm::dvec3 normal = glm::cross(ab, ac);
  return std::abs(glm::dot(ap, normal)) / glm::length(normal);
}

SimplifyReport simplify_mesh(TriangleMesh& mesh, float deviation_m, std::optional<float> first_target_m) {
  require(deviation_m > 0 && deviation_m <= 1, "simplify_m", deviation_m, "must be in (0, 1] m");
  SimplifyReport report;
  report.triangles_before = mesh.triangles.size();
  std::map<std::pair<std::uint32_t, std::uint32_t>, Corners> parts;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    Corners& part = parts[{mesh.triangle_material[t], mesh.triangle_object[t]}];
    for (int corner = 0; corner < 3; ++corner) part.push_back(mesh.triangles[t][corner]);
  }
  TriangleMesh simple;
  simple.vertices = mesh.vertices;
  simple.material_names = mesh.material_names;
  simple.object_names = mesh.object_names;
  simple.origin_m = mesh.origin_m;
  for (const auto& [key, part] : parts) {
    Corners left = part;
    double moved_m = 0;
    // The quadric error can be far off on thin and folded parts: a part with too large an error is simplified again, less.
    for (float target_m = first_target_m.value_or(deviation_m); target_m > least_fraction * deviation_m; target_m *= 0.5f) {
      const Corners candidate = simplify_part(mesh, part, target_m);
      const double candidate_m = deviation_of(mesh, part, candidate);
      if (candidate_m > deviation_m) continue;
      left = candidate;
      moved_m = candidate_m;
      break;
    }
    report.deviation_m = std::max(report.deviation_m, moved_m);
    for (std::size_t t = 0; t < left.size(); t += 3) {
      simple.triangles.emplace_back(left[t], left[t + 1], left[t + 2]);
      simple.triangle_material.push_back(key.first);
      simple.triangle_object.push_back(key.second);
    }
  }
  ImportReport unused;
  repair_mesh(simple, unused);
  mesh = std::move(simple);
  report.triangles_after = mesh.triangles.size();
  return report;
}

}  // namespace earshot
