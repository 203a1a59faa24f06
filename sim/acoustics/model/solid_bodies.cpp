// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/solid_bodies.h"

#include <algorithm>
#include <cstddef>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numeric>
#include <utility>

#include "sim/scene/mesh/mesh_repair.h"

namespace earshot {
namespace {

constexpr float kWeldM = 1e-4f;

struct Edge {
  std::uint32_t low, high, triangle;
  bool rises;  ///< passed from low to high
};

std::uint32_t root_of(std::vector<std::uint32_t>& parents, std::uint32_t item) {
  while (parents[item] != item) item = parents[item] = parents[parents[item]];
  return item;
}

std::vector<Edge> edges_of(const TriangleMesh& mesh) {
  const std::vector<std::uint32_t> welded = weld_map(mesh.vertices, kWeldM);
  std::vector<Edge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
    for (int side = 0; side < 3; ++side) {
      const std::uint32_t a = welded[mesh.triangles[t][side]], b = welded[mesh.triangles[t][(side + 1) % 3]];
      if (a != b) edges.push_back({std::min(a, b), std::max(a, b), t, a < b});
    }
  std::ranges::sort(edges, {}, [](const Edge& edge) { return std::pair(edge.low, edge.high); });
  return edges;
}

}  // namespace

std::vector<std::uint8_t> bounds_of_bodies(const TriangleMesh& mesh) {
  std::vector<std::uint32_t> parents(mesh.triangles.size());
  std::iota(parents.begin(), parents.end(), 0u);
  const std::vector<Edge> edges = edges_of(mesh);
  std::vector<std::uint32_t> open;  // triangles at edges that do not balance
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    int balance = 0;
    for (; end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high; ++end) {
      balance += edges[end].rises ? 1 : -1;
      parents[root_of(parents, edges[end].triangle)] = root_of(parents, edges[begin].triangle);
    }
    if (balance != 0) open.push_back(edges[begin].triangle);
  }
  // Six times the volume, about a vertex of its own, so that places far from the origin keep their digits.
  std::vector<double> volume(mesh.triangles.size(), 0.0);
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::uint32_t root = root_of(parents, t);
    const glm::dvec3 origin(mesh.vertices[mesh.triangles[root].x]);
    const auto corner = [&](int i) { return glm::dvec3(mesh.vertices[mesh.triangles[t][i]]) - origin; };
    volume[root] += glm::dot(corner(0), glm::cross(corner(1), corner(2)));
  }
  for (const std::uint32_t triangle : open) volume[root_of(parents, triangle)] = 0;
  std::vector<std::uint8_t> bounds(mesh.triangles.size());
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) bounds[t] = volume[root_of(parents, t)] > 0;
  return bounds;
}

}  // namespace earshot
