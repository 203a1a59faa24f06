// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "sim/scene/scene.h"

namespace earshot {

/// Octave bands of the report, centres in hertz.
inline constexpr std::array<float, 7> report_bands_hz{125, 250, 500, 1000, 2000, 4000, 8000};

/// What `earshot scene` prints about the geometry (navigable area is added by the caller).
struct SceneReport {
  std::uint64_t triangles = 0;
  std::uint64_t open_edges = 0;  ///< edges of one triangle only, after joining equal vertices
  ImportReport removed;          ///< and the warnings of the import
  /// Fraction of 16,384 rays, sent in all directions from points of the air, that hit something: 1 in a closed room, 0 without a floor.
  /// The air: of 16,384 stratified points of the bounds, those that have a floor below and belong to the largest region whose points
  /// are in line of sight of each other, directly or through others (so not the inside of walls and furniture).
  double ray_efficiency = 0;
  double leaked_ray_fraction = 0;  ///< 1 - ray_efficiency
  double volume_m3 = 0;            ///< of that air; of the bounds if more than `open_fraction` of the rays leak
  double area_m2 = 0;  ///< surface around that air: 4 V / mean free path of a diffuse walk (each side of a sheet counts); NaN if open
  /// Per band of report_bands_hz; Eyring, 24 ln 10 V / (c (4 m V - S ln(1 - a))), with a and S as the diffuse walk meets them.
  /// NaN if open, infinite if nothing absorbs.
  std::vector<double> rt60_estimate_s;

  static constexpr double open_fraction = 0.05;  ///< of leaked rays, from where a scene counts as open
};

/// Same scene and seed, same numbers.  About 0.2 s for 150,000 triangles.
/// air_exponent_per_m: energy attenuation of air m per band, exp(-m r) (ISO 9613-1, from sim/acoustics); empty: no air absorption.
SceneReport report_scene(const Scene& scene, std::uint64_t seed = 0, std::span<const double> air_exponent_per_m = {});

}  // namespace earshot
