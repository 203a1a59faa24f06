// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>

#include "sim/acoustics/core/energy_decay.h"
#include "sim/acoustics/metrics/parameter_request.h"

namespace earshot {

struct BandMetricKey {
  const char* key;
  std::optional<double> BandMetrics::*value;
};

/// Metrics per band under the names of JSON and of Python (docs/reference/json_output.md, section 1), in that order.
inline constexpr std::array<BandMetricKey, 14> kBandMetricKeys{{{"edt_s", &BandMetrics::edt_s},
                                                                {"edt_after_direct_s", &BandMetrics::edt_after_direct_s},
                                                                {"t20_s", &BandMetrics::t20_s},
                                                                {"t30_s", &BandMetrics::t30_s},
                                                                {"rt60_s", &BandMetrics::rt60_s},
                                                                {"c50_db", &BandMetrics::c50_db},
                                                                {"c80_db", &BandMetrics::c80_db},
                                                                {"d50", &BandMetrics::d50},
                                                                {"ts_s", &BandMetrics::ts_s},
                                                                {"g_db", &BandMetrics::g_db},
                                                                {"drr_band_db", &BandMetrics::drr_db},
                                                                {"iacc", &BandMetrics::iacc},
                                                                {"iacc_early", &BandMetrics::iacc_early},
                                                                {"iacc_late", &BandMetrics::iacc_late}}};

/// Of those on request (parameter_request.h): in JSON only where their group is asked for.
struct RequestedMetricKey {
  const char* key;
  std::optional<double> BandMetrics::*value;
  bool ParameterRequest::*group;
};
inline constexpr std::array<RequestedMetricKey, 6> kRequestedMetricKeys{
    {{"j_lf", &BandMetrics::j_lf, &ParameterRequest::lateral},
     {"j_lfc", &BandMetrics::j_lfc, &ParameterRequest::lateral},
     {"lg_db", &BandMetrics::lg_db, &ParameterRequest::lateral},
     {"st_early_db", &BandMetrics::st_early_db, &ParameterRequest::stage},
     {"st_late_db", &BandMetrics::st_late_db, &ParameterRequest::stage},
     {"mti", &BandMetrics::mti, &ParameterRequest::speech}}};

}  // namespace earshot
