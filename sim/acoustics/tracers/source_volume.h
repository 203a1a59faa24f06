// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <limits>

#include "sim/acoustics/core/sampling.h"
#include "sim/acoustics/model/acoustic_scene.h"

/// The sphere around a source in which paths are caught that no connection can reach.
namespace earshot {

/// Radius of the source volume: as configured, or less where a surface is nearer.
inline float free_radius_m(const AcousticScene& scene, glm::vec3 source) {
  constexpr std::uint32_t probes = 64;
  const SphereSequence directions(0x80000000u, 0x80000000u);
  float nearest_m = std::numeric_limits<float>::infinity();
  for (std::uint32_t i = 0; i < probes; ++i) {
    nearest_m = std::min(nearest_m, scene.scene().rays().intersect(source, directions.direction(i)).distance_m);
  }
  const float radius_m = std::min(scene.config().source_radius_m, 0.9f * nearest_m);
  // On a surface there is no space for a sphere: the volume of a tiny one would underflow.
  return radius_m > 1e-6f * scene.diagonal_m() ? radius_m : 0.f;
}

/// Part of a ray's segment that lies inside the sphere; empty (leave_m <= enter_m) if it misses.
struct Chord {
  float enter_m = 0, leave_m = 0;
};
inline Chord chord_through(glm::vec3 centre, float radius_m, glm::vec3 origin, glm::vec3 direction, float segment_m) {
  const glm::vec3 to_centre = centre - origin;
  const float along_m = glm::dot(to_centre, direction);
  const glm::vec3 miss = to_centre - along_m * direction;
  const float half2 = radius_m * radius_m - glm::dot(miss, miss);
  if (!(half2 > 0)) return {};
  const float half_m = std::sqrt(half2);
  return {std::max(along_m - half_m, 0.f), std::min(along_m + half_m, segment_m)};
}

/// Point in a sphere from three numbers in [0, 1), uniform over its volume.
inline glm::vec3 point_in_sphere(glm::vec3 centre, float radius_m, float u, float v, float w) {
  return centre + radius_m * std::cbrt(w) * sphere_direction(u, v);
}

}  // namespace earshot
