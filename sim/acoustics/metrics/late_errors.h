#pragma once

#include <optional>
#include <vector>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Standard errors of one band of a response, from the spread of its batches.
struct BandErrors {
  double late_energy = 0, late_energy_error = 0;  ///< Green units, summed over time
  /// Of T20 and T30 in seconds: jackknife over batches (Quenouille 1956, Tukey 1958).  nullopt where the decay time itself does not exist.
  std::optional<double> t20_error_s, t30_error_s;
};

/// One entry per band; empty if the response was not traced in batches.  Cost: the metrics of one response per batch.
std::vector<BandErrors> late_errors(const AcousticScene& scene, const EnergyResponse& response);

}  // namespace earshot
