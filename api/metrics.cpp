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

constexpr std::array<MetricField, 14> kFields{{{"edt_s", &Metrics::edt_s},
                                               {"edt_after_direct_s", &Metrics::edt_after_direct_s},
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

constexpr std::array<MetricField, 6> kRequestedFields{{{"j_lf", &Metrics::j_lf},
                                                       {"j_lfc", &Metrics::j_lfc},
                                                       {"lg_db", &Metrics::lg_db},
                                                       {"st_early_db", &Metrics::st_early_db},
                                                       {"st_late_db", &Metrics::st_late_db},
                                                       {"mti", &Metrics::mti}}};

template <class Fields, class Keys>
constexpr bool fields_match(const Fields& fields, const Keys& keys) {
  if (fields.size() != keys.size()) return false;
  for (std::size_t i = 0; i < fields.size(); ++i)
    if (std::string_view(fields[i].name) != keys[i].key) return false;
  return true;
}
static_assert(fields_match(kFields, kBandMetricKeys) && fields_match(kRequestedFields, kRequestedMetricKeys));

double number(const std::optional<double>& value) { return value.value_or(std::numeric_limits<double>::quiet_NaN()); }

}  // namespace

std::span<const MetricField> metric_fields() { return kFields; }
std::span<const MetricField> requested_metric_fields() { return kRequestedFields; }

Metrics metrics_of(const RoomMetrics& found) {
  Metrics metrics;
  metrics.bands_hz.assign(found.bands_hz.begin(), found.bands_hz.end());
  for (const BandMetrics& band : found.bands) {
    for (std::size_t i = 0; i < kFields.size(); ++i) (metrics.*kFields[i].values).push_back(number(band.*kBandMetricKeys[i].value));
    for (std::size_t i = 0; i < kRequestedFields.size(); ++i)
      (metrics.*kRequestedFields[i].values).push_back(number(band.*kRequestedMetricKeys[i].value));
  }
  metrics.sti = number(found.sti);
  metrics.drr_db = number(found.drr_db);
  metrics.direct_delay_s = number(found.direct_delay_s);
  metrics.direct_amplitude = number(found.direct_amplitude);
  for (const MissingParameter& missing : found.missing) metrics.missing.push_back({missing.key, missing.reason});
  return metrics;
}

ParameterRequest request_of(const ParameterOptions& parameters) {
  return parameter_request(parameters.groups, parameters.speech_snr_db, "parameters", "speech_snr_db");
}

Metrics measure(const Rir& rir, const MeasureOptions& options) {
  if (rir.num_channels < 1 || rir.num_samples < 1 ||
      rir.samples.size() != static_cast<std::size_t>(rir.num_channels) * static_cast<std::size_t>(rir.num_samples))
    throw InputError("rir", "has a wrong shape", "give [channels, samples]");
  require(rir.sample_rate_hz > 0 && std::isfinite(rir.sample_rate_hz), "sample_rate_hz", rir.sample_rate_hz, "must be positive");
  RirMeasurement how{.direct_delay_s = options.direct_delay_s,
                     .request = request_of(options.parameters),
                     .lateral = options.lateral,
                     .reference_10m = options.reference,
                     .is_green = options.green_units,
                     .distance_m = options.distance_m};
  if (how.request.interaural)
    throw InputError("parameters", "'interaural' asks for standard errors, which a single response does not have", "leave it out");
  if (options.bands == "third_octaves")
    how.bands = MeasuredBands::third_octaves;
  else if (options.bands == "octaves")
    how.low_octave = true;
  else
    throw InputError("bands", "'" + options.bands + "' is not a kind of bands", "use octaves or third_octaves");
  const earshot::Rir measured{rir.num_channels, rir.num_samples, static_cast<float>(rir.sample_rate_hz), rir.samples};
  return metrics_of(earshot::measure(measured, how));
}

Metrics measure(const Rir& rir, double direct_delay_s) { return measure(rir, MeasureOptions{.direct_delay_s = direct_delay_s}); }

}  // namespace earshot::api
