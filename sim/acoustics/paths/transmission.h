#pragma once

#include <algorithm>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Two faces further apart than this, measured across the wall, are two walls.
inline constexpr float kMaxWallThicknessM = 0.6f;

/// Length of a leg to a point that stops before what the point itself lies on, as EmbreeScene::occluded has it: a source or listener on a
/// wall is before it.  Four times the spacing of floats there.
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
/// (docs/oracles.md, O-22).  The next hit along the ray is the far face of the same wall if it has the opposite winding, a material of the
/// same name and coefficients, and either a normal within 11 degrees and a distance of at most kMaxWallThicknessM across the wall, or,
/// where the windings point outward (corners and ends of walls), a distance of at most kMaxWallThicknessM along the ray.  Everything else
/// is a sheet.  Where three faces alternate, a pair whose windings point outward is a wall before one whose windings point inward, from
/// either side of the ray.  Triangles that coincide are passed together (docs/stability.md, H-5).  Cost: one ray, two for a wall whose
/// windings point inward.
WallCrossing cross_wall(const AcousticScene& scene, glm::vec3 direction, const Hit& hit);

/// Energy share that passes, per band: tau of the material once, times 10^(-damping * inside_m / 10).  share: [num_bands], multiplied by
/// it.
void transmit(const AcousticScene& scene, const WallCrossing& crossing, std::span<float> share);
/// What the crossing adds to a path counted in metres of air: inside_m (c / c_inside - 1); 0 without a speed of the material's own.
float extra_path_m(const AcousticScene& scene, const WallCrossing& crossing);

/// Quieter than this a band passes nothing (docs/stability.md, H-69).
inline constexpr double kSilentTransmissionDb = -200.0;

/// Appends what goes straight from source to listener through the walls between them: at most one arrival, of kind transmission, with the
/// number of walls as its order; inserted where `arrivals`, sorted by distance, stays sorted.  Nothing if the line of sight is free (that
/// is the direct sound), if more than config.transmission_walls objects are in the way, if no band passes, if it comes after the end of the
/// RIR, or with config.transmission off.  Losses add in dB per band; air absorbs outside the walls only; the delay is that of the material
/// inside one with a speed of its own.  Refraction is left out, as is all but the straight line: reflections seen through walls are the
/// late field's. Source and listener swapped give the bits of the same distance and amplitudes. Cost: nothing in a scene where no material
/// transmits; otherwise one shadow ray, and one or two rays per wall if it is blocked.  No allocation once `arrivals` has room.
void find_transmitted(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals);
/// The same for a line of sight that is known to be blocked, in a scene whose plan has straight transmission: no shadow ray.
void find_transmitted_behind_walls(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, std::vector<Arrival>& arrivals);

}  // namespace earshot
