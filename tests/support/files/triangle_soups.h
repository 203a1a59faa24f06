// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <glm/vec3.hpp>
#include <numbers>
#include <vector>

#include "sim/rays/embree_scene.h"

/// Plain triangles for tests of ray queries.
namespace earshot::soups {

/// Triangles without any order.
struct Soup {
  std::vector<glm::vec3> vertices;
  std::vector<glm::uvec3> triangles;
};

/// Six faces of n x n squares, closed, each face with vertices of its own (edges meet only by position).
inline Soup tessellated_cube(unsigned n, float size_m, float offset_m) {
  Soup soup;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float side : {0.f, 1.f}) {
      const auto first = static_cast<unsigned>(soup.vertices.size());
      for (unsigned i = 0; i <= n; ++i) {
        for (unsigned j = 0; j <= n; ++j) {
          glm::vec3 v;
          v[axis] = side * size_m + offset_m;
          v[(axis + 1) % 3] = static_cast<float>(i) / static_cast<float>(n) * size_m + offset_m;
          v[(axis + 2) % 3] = static_cast<float>(j) / static_cast<float>(n) * size_m + offset_m;
          soup.vertices.push_back(v);
        }
      }
      for (unsigned i = 0; i < n; ++i) {
        for (unsigned j = 0; j < n; ++j) {
          const unsigned a = first + i * (n + 1) + j, b = a + 1, c = a + n + 1, d = c + 1;
          soup.triangles.emplace_back(a, b, d);
          soup.triangles.emplace_back(a, d, c);
        }
      }
    }
  }
  return soup;
}

/// Two triangles over the rectangle [lower, upper] of the plane y = height.
inline void append_rectangle(Soup& soup, float x0, float z0, float x1, float z1, float height) {
  const auto first = static_cast<unsigned>(soup.vertices.size());
  soup.vertices.insert(soup.vertices.end(), {{x0, height, z0}, {x1, height, z0}, {x1, height, z1}, {x0, height, z1}});
  soup.triangles.emplace_back(first, first + 1, first + 2);
  soup.triangles.emplace_back(first, first + 2, first + 3);
}

inline EmbreeScene build(const Soup& soup) { return EmbreeScene(soup.vertices, soup.triangles); }

inline glm::vec3 uniform_direction(std::array<float, 2> u) {
  const float y = 1 - 2 * u[0], radius = std::sqrt(std::max(0.f, 1 - y * y)), angle = 2 * std::numbers::pi_v<float> * u[1];
  return {radius * std::cos(angle), y, radius * std::sin(angle)};
}

}  // namespace earshot::soups
