// SPDX-License-Identifier: Apache-2.0
#include "earshot/metrics.h"

#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>

#include "api/room_metrics.h"
#include "earshot/rir.h"
#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/base/errors.h"

namespace earshot::api {
namespace {

constexpr std::array<MetricField, 13> kFields{{{"edt_s", &Metrics::edt_s},
                                               {"t20_s", &Metrics::t20_s},
                                               {"t30_s", &Metrics::t30_s},
                                               {"rt60_s", &Metrics::rt60_s},
                                               {"c50_db", &Metrics::c50_db},
                                               {"c80_db", &Metrics::c80_db},
                                               {"d50", &Metrics::d50},
                                               {"ts_s", &Metrics::ts_s},
                                               {"g_db", &Metrics::g_db},
                                               {"drr_band_db", &Metrics::drr_band_db},
                                               {"iacc", &Metrics::iacc},
                                               {"iacc_early", &Metrics::iacc_early},
                                               {"iacc_late", &Metrics::iacc_late}}};

constexpr bool fields_match_engine() {
  if (kFields.size() != kBandMetricKeys.size()) return false;
  for (std::size_t i = 0; i < kFields.size(); ++i)
    if (std::string_view(kFields[i].name) != kBandMetricKeys[i].key) return false;
  return true;
}
static_assert(fields_match_engine());

double number(const std::optional<double>& value) { return value.value_or(std::numeric_limits<double>::quiet_NaN()); }

}  // namespace

std::span<const MetricField> metric_fields() { return kFields; }

Metrics metrics_of(const RoomMetrics& found) {
  Metrics metrics;
  metrics.bands_hz.assign(found.bands_hz.begin(), found.bands_hz.end());
  for (std::size_t i = 0; i < kFields.size(); ++i)
    for (const BandMetrics& band : found.bands) (metrics.*kFields[i].values).push_back(number(band.*kBandMetricKeys[i].value));
  metrics.drr_db = number(found.drr_db);
  metrics.direct_delay_s = number(found.direct_delay_s);
  metrics.direct_amplitude = number(found.direct_amplitude);
  return metrics;
}

Metrics measure(const Rir& rir, double direct_delay_s) {
  if (rir.num_channels < 1 || rir.num_samples < 1 ||
      rir.samples.size() != static_cast<std::size_t>(rir.num_channels) * static_cast<std::size_t>(rir.num_samples))
    throw InputError("rir", "has a wrong shape", "give [channels, samples]");
  require(rir.sample_rate_hz > 0 && std::isfinite(rir.sample_rate_hz), "sample_rate_hz", rir.sample_rate_hz, "must be positive");
  require(direct_delay_s >= 0 && std::isfinite(direct_delay_s), "direct_delay_s", direct_delay_s, "must be at least 0");
  const earshot::Rir measured{rir.num_channels, rir.num_samples, static_cast<float>(rir.sample_rate_hz), rir.samples};
  return metrics_of(earshot::measure(measured, direct_delay_s));
}

}  // namespace earshot::api
