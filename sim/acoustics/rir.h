#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <vector>

#include "sim/acoustics/acoustic_scene.h"
#include "sim/acoustics/early_reflections.h"
#include "sim/acoustics/energy_histogram.h"
#include "sim/acoustics/path_tracer.h"

namespace earshot {

/// Everything the listener receives from one source, before any head or microphone: independent of heading.
struct EnergyResponse {
  std::vector<Arrival> arrivals;  ///< direct and early, sorted by distance
  EnergyHistogram late;
  TraceStats stats;
  float speed_of_sound_m_per_s = 0;  ///< turns distances of arrivals into times; > 0 once computed
};

/// Energy response of (scene, source, listener).  A pure function of its arguments and the config: the same pose gives the same bits
/// whenever and wherever it is asked.  Reuses the storage of `response`; no allocation once warm (single-threaded config).
void compute_energy_response(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener, EnergyResponse& response);

}  // namespace earshot
