// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/mesh/patch_collapse.h"

#include <algorithm>
#include <cstddef>
#include <glm/geometric.hpp>

namespace earshot {
namespace {

/// Height over longest side, of new triangles.
constexpr double kNarrowest = 0.01;
constexpr int kMaxPasses = 64;

/// Twice the area, positive counterclockwise.
double twice_area(glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); }

/// Height over longest side; not positive if it is turned over.
double shape_of(glm::dvec2 a, glm::dvec2 b, glm::dvec2 c) {
  const double longest2 = std::max({glm::dot(b - a, b - a), glm::dot(c - b, c - b), glm::dot(a - c, a - c)});
  return longest2 > 0 ? twice_area(a, b, c) / longest2 : 0;
}

class Collapse {
 public:
  explicit Collapse(FlatPatch& patch) : patch_(patch), alive_(patch.triangles.size(), true), around_(patch.vertices.size()) {
    for (std::uint32_t t = 0; t < patch.triangles.size(); ++t)
      for (const std::uint32_t vertex : patch.triangles[t]) around_[vertex].push_back(t);
  }

  void run() {
    bool has_collapsed = true;
    for (int pass = 0; has_collapsed && pass < kMaxPasses; ++pass) {
      has_collapsed = false;
      for (std::uint32_t v = 0; v < patch_.vertices.size(); ++v)
        if (!patch_.is_border[v] && !around_[v].empty()) has_collapsed = try_collapse(v) || has_collapsed;
    }
    std::size_t kept = 0;
    for (std::size_t t = 0; t < patch_.triangles.size(); ++t)
      if (alive_[t]) patch_.triangles[kept++] = patch_.triangles[t];
    patch_.triangles.resize(kept);
  }

 private:
  using Triangle = std::array<std::uint32_t, 3>;

  [[nodiscard]] static bool has(const Triangle& triangle, std::uint32_t vertex) {
    return triangle[0] == vertex || triangle[1] == vertex || triangle[2] == vertex;
  }

  /// Worst shape of the fan that fills the hole of `v` from `u`.  The signed area of a fan is that of its hole from wherever it spreads: if
  /// no triangle of it is turned over, it covers the hole once.
  [[nodiscard]] double worst_shape(std::uint32_t v, std::uint32_t u) const {
    double worst = 1;
    for (const std::uint32_t t : around_[v]) {
      const Triangle& old = patch_.triangles[t];
      if (has(old, u)) continue;
      std::array<glm::dvec2, 3> corner;
      for (std::size_t i = 0; i < 3; ++i) corner[i] = patch_.vertices[old[i] == v ? u : old[i]];
      worst = std::min(worst, shape_of(corner[0], corner[1], corner[2]));
      if (worst < kNarrowest) return worst;
    }
    return worst;
  }

  bool try_collapse(std::uint32_t v) {
    double best = kNarrowest;
    std::uint32_t to = v;
    for (const std::uint32_t t : around_[v])
      for (std::size_t i = 0; i < 3; ++i) {
        if (patch_.triangles[t][i] != v) continue;
        const std::uint32_t u = patch_.triangles[t][(i + 1) % 3];  // each neighbour comes after v in one triangle
        if (const double worst = worst_shape(v, u); worst > best) best = worst, to = u;
      }
    if (to == v) return false;
    for (const std::uint32_t t : around_[v]) {
      Triangle& triangle = patch_.triangles[t];
      if (has(triangle, to)) {
        alive_[t] = false;
        for (const std::uint32_t vertex : triangle)
          if (vertex != v) std::erase(around_[vertex], t);
      } else {
        std::replace(triangle.begin(), triangle.end(), v, to);
        around_[to].push_back(t);
      }
    }
    around_[v].clear();
    return true;
  }

  FlatPatch& patch_;
  std::vector<bool> alive_;
  std::vector<std::vector<std::uint32_t>> around_;  ///< living triangles of each vertex
};

}  // namespace

void collapse_inner_vertices(FlatPatch& patch) { Collapse(patch).run(); }

}  // namespace earshot
