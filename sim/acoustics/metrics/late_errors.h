#pragma once

#include <optional>
#include <vector>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Standard errors of one band of a response, from the spread of its batches.
struct BandErrors {
  double late_energy = 0, late_energy_error = 0;  ///< Green units, summed over time
  /// Jackknife over batches (Quenouille 1956, Tukey 1958), times Student's over Gauss's quantile for so few of them: twice the error covers
  /// 95 % whatever their number.  nullopt where the value itself does not exist.
  std::optional<double> edt_error_s, t20_error_s, t30_error_s, c50_error_db, c80_error_db, g_error_db, drr_error_db;
};

/// One entry per band; empty if the response was not traced in batches.  Cost: the metrics of one response per batch.
std::vector<BandErrors> late_errors(const AcousticScene& scene, const EnergyResponse& response);

}  // namespace earshot
