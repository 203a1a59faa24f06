// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <span>

#include "sim/rays/embree_scene.h"

namespace earshot {

/// Embree and nothing else: the same triangles without the rules of EmbreeScene for ties, ends and edges, filled in as its tutorials do.
/// Benchmarks report ray rates relative to it, so that results carry over to other machines.  Immutable, safe from any thread.
class BareRays {
 public:
  /// Copies both.  Throws InputError if Embree cannot be opened or built.
  BareRays(std::span<const glm::vec3> vertices, std::span<const glm::uvec3> triangles);
  ~BareRays();
  /// Distances of sixteen coherent rays from one origin (a block of a camera's pixels), infinity where a ray escapes.
  void closest16(glm::vec3 origin, const Directions16& directions, std::span<float, 16> distances_m) const;
  struct Bounce {
    float distance_m;  ///< infinity: escaped
    glm::vec3 normal;  ///< not normalised; zero where the ray escaped
  };
  /// Nearest hit of one ray that has no neighbours (a diffuse bounce); hits nearer than 1 mm do not count.
  [[nodiscard]] Bounce closest(glm::vec3 origin, glm::vec3 direction) const;

 private:
  struct Handles;
  std::unique_ptr<Handles> handles_;
};

}  // namespace earshot
