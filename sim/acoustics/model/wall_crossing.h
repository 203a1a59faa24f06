// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/vec3.hpp>
#include <limits>
#include <span>

#include "sim/acoustics/model/acoustic_surfaces.h"

namespace earshot {

/// Two faces further apart than this, measured across the wall, are two walls, unless they bound a solid.
inline constexpr float kMaxWallThicknessM = 0.6f;

/// Length of a segment to a point that stops before what the point itself lies on, as EmbreeScene::occluded has it: a source or listener on
/// a wall is before it.  Four times the spacing of floats there.
inline float open_length_m(glm::vec3 to, float length_m) {
  const glm::vec3 size = glm::abs(to);
  return length_m - 0x1p-22f * std::max({size.x, size.y, size.z, length_m});
}

/// One object that a ray goes through: a sheet, or both faces of a wall that was modelled with a thickness.
struct WallCrossing {
  glm::vec3 exit{0};           ///< moved off the far side: the ray goes on from here
  float inside_m = 0;          ///< length of the ray inside; 0: a sheet
  std::uint32_t material = 0;  ///< slot
  bool thick = false;          ///< two faces; their distance is known
};

/// The object that begins at `hit`, the nearest hit of the ray (origin, direction).  `direction` is unit.
///
/// Transmission belongs to the object, not to its faces, so that a sheet and a box of the same wall let the same energy through
/// (docs/evidence/oracles.md, O-22).  The next hit along the ray is the far face of the same wall if it has the opposite winding, a
/// material of the same name and coefficients, and either a normal within 11 degrees and a distance of at most kMaxWallThicknessM across
/// the wall, or, where the windings point outward (corners and ends of walls), a distance of at most kMaxWallThicknessM along the ray.
/// Where both faces bound a solid (AcousticSurfaces::bounds_solid), any distance within reach_m is inside, at any angle.
/// Everything else is a sheet.  Where three faces alternate, a pair whose windings point outward is a wall before one whose windings point
/// inward, from either side of the ray.  Triangles that coincide are passed together (docs/evidence/stability.md, H-5).  Cost: one ray, two
/// for a wall whose windings point inward.
/// reach_m: from the hit to where the ray ends; a point within two faces is in a room, not in a solid.
WallCrossing cross_wall(const AcousticSurfaces& surfaces, glm::vec3 direction, const Hit& hit,
                        float reach_m = std::numeric_limits<float>::infinity());

/// Multiplies `energy` [num_bands] by the fraction that passes: tau of the material once, times 10^(-damping * inside_m / 10).
void transmit(const AcousticSurfaces& surfaces, const WallCrossing& crossing, std::span<float> energy);
/// Length that the crossing adds to a path, in metres of air: inside_m (c / c_inside - 1); 0 if the material states no speed of sound.
float extra_path_m(const AcousticSurfaces& surfaces, const WallCrossing& crossing);

}  // namespace earshot
