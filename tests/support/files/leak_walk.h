// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>

#include "sim/rays/embree_scene.h"
#include "tests/support/files/mesh_cases.h"

namespace earshot {

struct LeakCounts {
  std::uint64_t bounces = 0, escapes = 0, same_triangle = 0;
};

/// Lambert bounces inside a closed mesh that contains `centre`, whose parts are all within `size_m` of it: what leaves it leaked, whether
/// it goes to infinity or is caught again by the outside.  After a leak the walk starts anew from the centre.
inline LeakCounts walk_inside(const EmbreeScene& rays, glm::dvec3 centre, double size_m, std::uint32_t bounces, std::uint32_t stream = 0) {
  LeakCounts counts;
  glm::vec3 from = centre, direction = mesh_cases::random_direction(0, 100 + stream);
  std::uint32_t last = Hit::no_triangle;
  for (std::uint32_t i = 1; i <= bounces; ++i) {
    const Hit hit = rays.intersect(from, direction);
    ++counts.bounces;
    if (!hit.valid() || glm::length(glm::dvec3(hit.position) - centre) > size_m) {
      ++counts.escapes;
      from = centre;
      last = Hit::no_triangle;
      direction = mesh_cases::random_direction(i, 200 + stream);
      continue;
    }
    counts.same_triangle += hit.triangle == last;
    last = hit.triangle;
    from = offset_from_surface(hit.position, hit.normal);
    const glm::vec3 sum = hit.normal + 0.99999f * mesh_cases::random_direction(i, 300 + stream);
    direction = glm::normalize(sum);
  }
  return counts;
}

}  // namespace earshot
