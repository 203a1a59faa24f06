// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"

namespace earshot {

class ListenerPaths;

/// Of the scene's diagonal: shortest distance in the geometry term (docs/evidence/stability.md, H-18).  Small, because scenes with 20 km of
/// ground are legal.
inline constexpr float kMinDistanceFraction = 1e-5f;

/// Counters of one trace.
struct TraceStats {
  std::uint64_t rays = 0;                       ///< listener rays
  std::uint64_t ray_hits = 0, ray_escapes = 0;  ///< of all traced segments
  std::uint64_t shadow_rays = 0;
  std::uint64_t nonfinite_dropped = 0;  ///< contributions that were NaN or infinite
  /// Adds the counters of a part; `rays` stays that of the whole.
  void add(const TraceStats& part);
  /// Fraction of traced segments that hit geometry (RLR's "ray efficiency"); 1 in a closed room, 0 if nothing was traced.
  [[nodiscard]] double ray_efficiency() const;
};

/// Late field of a unit source at `listener`: listener-rooted path tracing with next-event estimation (docs/explanation/estimators.md,
/// section 1), a mixture of Lambert and mirror reflection by the scattering coefficient per band.  Rays are under population control: light
/// ones end, heavy ones split (ray_population.h), which keeps every mean and makes the tail as accurate as the start.  Air is applied at
/// the end, per bin.  Left out: the direct sound, and the purely specular paths whose plane sequence is among `candidates` (image paths
/// carry them).
///
/// Specular last segments, which next-event estimation cannot reach (config.diffuse_last_segment):
///  - false (reference): the source is also a sphere of config.source_radius_m that blocks nothing; segments that leave a mirror add their
///    chord through it (track-length estimator), which is the mean of the response over the sphere.  A sphere cut by a wall would be
///    biased, so the radius is reduced to 0.9 of the distance to the nearest surface found by 64 rays.  Unbiased up to that average, noisy.
///  - true (fast): the last segment of a late path is treated as diffuse.  No such noise; small bias where s is small.
///
/// The source radiates by candidates.emission(), from the volume of a sphere if its radius_m > 0.  With config.transmission on (automatic:
/// not here, see traces_transmission) rays pass walls by chance, weighed per band, and last segments reach the source through walls; what
/// goes straight from source to listener through walls is left out (find_transmitted carries it).
///
/// histogram: shape of make_histogram(scene); overwritten.  The result is a function of (scene, config, source, listener), not of threads.
/// Distances to the source below 1e-5 of the scene's diagonal are clamped in the geometry term (docs/evidence/stability.md, H-18).  A
/// source within a few centimetres of a surface lights a patch that few rays find: its late field comes out low until the number of rays is
/// large. No allocation with up to 256 rays; 64 rays take about a millisecond.  Scratch with more: a few histograms. paths: keeps the rays
/// of a listener that stays where it is while sources move (listener_paths.h), with the same bits; null: does not.
TraceStats trace_late(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyHistogram& histogram,
                      ListenerPaths* paths = nullptr);
/// The same with candidates made on the spot, for single queries.
TraceStats trace_late(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, EnergyHistogram& histogram);

/// Histogram of the configured length, bands and SH order.
EnergyHistogram make_histogram(const AcousticScene& scene);
/// Does `histogram` have that shape?
bool has_shape_of(const AcousticScene& scene, const EnergyHistogram& histogram);

}  // namespace earshot
