// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <vector>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/model/wall_power.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/paths/pose_effects.h"
#include "sim/acoustics/tracers/bidirectional_tracer.h"
#include "sim/acoustics/tracers/listener_paths.h"
#include "sim/acoustics/tracers/path_tracer.h"

namespace earshot {

class SourceField;

/// Everything the listener receives from one source, before any head or microphone: independent of heading.
struct EnergyResponse {
  std::vector<Arrival> arrivals;  ///< of every kind (arrival.h), sorted by distance
  EnergyHistogram late;
  WallGain wall_gain;              ///< of source and listener together, part of `late`, `scattered` and `batches`
  std::vector<Arrival> scattered;  ///< energy that panels scatter instead of reflecting; part of `late`
  TraceStats stats;
  EffectCounters effects;            ///< of this pose
  LateBatches batches;               ///< parts of the late field for late_errors(); only from the bidirectional tracer
  float speed_of_sound_m_per_s = 0;  ///< turns distances of arrivals into times; > 0 once computed
  AirLoss air;                       ///< that the arrivals have behind them, for their spectra between the centres of bands
  ListenerMemory memory;             ///< of the rays of this listener, for sources that move; no part of the result
};

/// Energy response of (scene, source, listener).  A pure function of its arguments and the config: the same pose gives the same bits
/// at any time, on any thread and in any worker.  Throws InputError if `listener` is not finite or further out than kMaxCoordinateM
/// (sim/base/coordinates.h). A non-finite value inside is dropped where it arises and counted in stats.nonfinite_dropped: nothing that
/// leaves is NaN or infinite. Reuses the storage of `response`, and the rays of a listener that has not moved since the response before
/// (listener_paths.h: a source that moves costs half as much then); no allocation once warm (single-threaded config, listener-rooted). The
/// late field is that of trace_bidirectional if config has source_rays or a specular_exponent, else of trace_late. progress: see
/// BidirectionalOptions; only the bidirectional tracer reports.
void compute_energy_response(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyResponse& response,
                             const std::function<void(double fraction)>& progress = {});
/// The same with the late field gathered from `field`, of the same source; null: traced as above.
void compute_energy_response(const AcousticScene& scene, const EarlyCandidates& candidates, const SourceField* field, glm::vec3 listener,
                             EnergyResponse& response, const std::function<void(double fraction)>& progress = {});

}  // namespace earshot
