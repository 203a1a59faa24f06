// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/model/acoustic_surfaces.h"

namespace earshot {

/// How far decays are followed.
inline constexpr double kProbedFallDb = 50.0;

/// Statistics of the surfaces from a few hundred rays.  They do not depend on the seed of the config, so that decisions do not change with
/// the random numbers of a run.
struct EffectProbe {
  std::vector<glm::vec3> points;                 ///< of the air, spread over the bounds; above a floor where possible
  double hit_fraction = 0;                       ///< of the segments of diffuse walks: 1 in a closed room
  double mean_free_path_m = 0;                   ///< of the segments that hit something
  std::vector<double> absorption, transmission;  ///< [num_bands], mean over hits
  double visible_fraction = 1;                   ///< of the pairs of points: 1 in a convex room, 0.1 to 0.3 in an apartment
  /// Of rays that end after `length_m` in the mean.
  [[nodiscard]] double segments_per_ray(double length_m) const {
    if (!(mean_free_path_m > 0)) return 1;
    return std::min(length_m / mean_free_path_m, 1.0 / std::max(1.0 - hit_fraction, 1e-9));
  }
  double query_us = 0;  ///< cost of one ray, a model of the number of triangles (a measurement would not be repeatable)

  /// Time in which the energy released at a point falls by kProbedFallDb without any air, [num_bands], the longest over all points,
  /// and over those of livelier rooms that none of them is in (air_points.h: live_points), where it is taken from the first 10 dB; by
  /// extrapolation where that is later than `horizon_s`; 0 where nothing comes back.
  std::vector<double> decay_s;
  /// The same with air.
  std::vector<double> decay_with_air_s;
  double horizon_s = 0;

  /// Behind walls that let sound through: the largest fraction by which the energy that reaches a room through its walls adds to what
  /// reaches it through the air, [num_bands] (docs/explanation/effect_bounds.md, section 1: E_up / E_lo).  Zero if no wall has air behind
  /// it; infinite if most walls lead to where no air does.
  std::vector<double> wall_to_air;
};

/// A few milliseconds: 32 points, 256 walks of at most `horizon_s`, up to 12 walls if something transmits, a survey of at most 1024 places
/// for livelier rooms and 120 short walks from what it finds (a sixth of the whole in a house).
/// `air_energy_per_m`: [num_bands].
EffectProbe probe_effects(const AcousticSurfaces& surfaces, std::span<const double> air_energy_per_m, double horizon_s);

/// Is a diffracting edge visible from any of these points of the air, or has the air round it a floor below?  The second finds those in
/// rooms that no point is in.  Boxes have edges too, outside.  A bounded search: with more than 100 edges the answer is yes.
bool edge_in_sight(const AcousticSurfaces& surfaces, std::span<const glm::vec3> air_points);

}  // namespace earshot
