// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "sim/acoustics/core/energy_decay.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Standard errors of one band of a response, from the spread of its batches.
struct BandErrors {
  double late_energy = 0, late_energy_error = 0;  ///< Green units, summed over time; energy scattered by panels counts as exact
  /// Jackknife over batches (Quenouille 1956, Tukey 1958), times Student's over Gauss's quantile for so few of them: twice the error covers
  /// 95 % whatever their number; in quadrature with what chains of mirrors may hold that no batch has found (LateBatches::unseen).  nullopt
  /// where the value itself does not exist.
  std::optional<double> edt_error_s, edt_after_direct_error_s, t20_error_s, t30_error_s, c50_error_db, c80_error_db, d50_error, ts_error_s,
      g_error_db, drr_error_db;
};

/// A statistic of a band and its error.
struct ErrorEntry {
  const char* key;  ///< as in JSON
  std::optional<double> BandMetrics::*value;
  std::optional<double> BandErrors::*error;
};
inline constexpr std::array<ErrorEntry, 10> kErrorEntries{
    {{"edt_s", &BandMetrics::edt_s, &BandErrors::edt_error_s},
     {"edt_after_direct_s", &BandMetrics::edt_after_direct_s, &BandErrors::edt_after_direct_error_s},
     {"t20_s", &BandMetrics::t20_s, &BandErrors::t20_error_s},
     {"t30_s", &BandMetrics::t30_s, &BandErrors::t30_error_s},
     {"c50_db", &BandMetrics::c50_db, &BandErrors::c50_error_db},
     {"c80_db", &BandMetrics::c80_db, &BandErrors::c80_error_db},
     {"d50", &BandMetrics::d50, &BandErrors::d50_error},
     {"ts_s", &BandMetrics::ts_s, &BandErrors::ts_error_s},
     {"g_db", &BandMetrics::g_db, &BandErrors::g_error_db},
     {"drr_band_db", &BandMetrics::drr_db, &BandErrors::drr_error_db}}};

/// One entry per band; empty if the response was not traced in batches.  Cost: the metrics of one response per batch and
/// octave of time.
std::vector<BandErrors> late_errors(const AcousticScene& scene, const EnergyResponse& response);

}  // namespace earshot
