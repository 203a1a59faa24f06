#pragma once

#include <cstdint>
#include <glm/vec3.hpp>

#include "sim/acoustics/acoustic_scene.h"
#include "sim/acoustics/energy_histogram.h"

namespace earshot {

/// Counters of one trace.
struct TraceStats {
  std::uint64_t rays = 0, ray_hits = 0, ray_escapes = 0, nonfinite_dropped = 0;
  /// Share of traced segments that hit geometry (RLR's "ray efficiency"); 1 in a closed room.
  [[nodiscard]] double ray_efficiency() const;
};

/// Late field at `listener` from a unit omnidirectional source: listener-rooted path tracing with next-event estimation
/// (ORACLES 2.1), a mixture of Lambert and mirror reflection by the scattering coefficient, unbiased Russian roulette.
/// Left out: the direct sound, and purely specular paths of at most `config.early_order` reflections (image paths carry them)
/// unless early reflections are off.  Air is applied at the end, per bin.
/// histogram: shape from make_histogram, added to.  The result is a function of (scene, config, source, listener): not of threads.
TraceStats trace_late(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener, EnergyHistogram& histogram);

/// Histogram of the configured length, bands and SH order.
EnergyHistogram make_histogram(const AcousticScene& scene);

}  // namespace earshot
