// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/room_metrics.h"

#include <fmt/format.h>

#include <cmath>

#include "sim/acoustics/metrics/response_series.h"

namespace earshot {
namespace {

/// Weights of the lateral parameters; nullopt where a response does not have them.
struct LateralWeights {
  std::optional<AxisWeight> squared_cosine, cosine;
};

LateralWeights lateral_weights(const ParameterRequest& request, const EnergyResponse& response, std::vector<MissingParameter>& missing) {
  LateralWeights weights;
  if (!request.lateral) return weights;
  if (!request.lateral_axis) {
    for (const char* key : {"j_lf", "j_lfc", "lg_db"})
      missing.push_back({key, "needs a source that is not straight above or below the listener: its null points at the source"});
    return weights;
  }
  const int coefficients = response.late.num_coefficients();
  const auto weight_of = [&](AxisWeight::Kind kind, std::optional<AxisWeight>& weight, std::initializer_list<const char*> keys) {
    const int order = AxisWeight::needed_order(kind);
    if (response.late.num_bins() > 0 && coefficients < (order + 1) * (order + 1)) {
      for (const char* key : keys) missing.push_back({key, fmt::format("needs harmonics of order {}: set sh_order={}", order, order)});
      return;
    }
    weight.emplace(kind, *request.lateral_axis, coefficients);
  };
  weight_of(AxisWeight::Kind::squared_cosine, weights.squared_cosine, {"j_lf", "lg_db"});
  weight_of(AxisWeight::Kind::cosine, weights.cosine, {"j_lfc"});
  return weights;
}

StageConditions stage_conditions(const EnergyResponse& response, const TimeZero& zero, double length_s) {
  StageConditions conditions{zero.has_direct, std::nullopt, length_s};
  for (const Arrival& arrival : response.arrivals)
    if (arrival.kind == ArrivalKind::direct && !conditions.distance_m) conditions.distance_m = double{arrival.distance_m};
  return conditions;
}

}  // namespace

RoomMetrics measure(const AcousticScene& scene, const EnergyResponse& response, const ParameterRequest& request) {
  RoomMetrics metrics;
  metrics.bands_hz = scene.bands().centre_hz;
  const TimeZero zero(response, scene.speed_of_sound_m_per_s());
  if (zero.has_direct) metrics.direct_delay_s = zero.start_s;
  metrics.bands.resize(scene.num_bands());
  if (!std::isfinite(zero.start_s)) {
    add_missing_silent(request, metrics.missing);
    return metrics;
  }
  metrics.first_arrival_s = zero.start_s;

  const double length_s = scene.config().rir_length_s - zero.start_s;
  const SeriesBins bins = series_bins(response.late.bin_s(), length_s);
  const LateralWeights weights = lateral_weights(request, response, metrics.missing);
  if (request.lateral) add_missing_lateral(length_s, metrics.missing);
  if (request.stage) add_missing_stage(stage_conditions(response, zero, length_s), metrics.missing);
  std::vector<std::vector<double>> after_direct;
  std::vector<double> direct;
  double direct_sum = 0, reverberant_sum = 0, bandwidth_sum = 0;
  for (int band = 0; band < scene.num_bands(); ++band) {
    const FirstSound first = first_sound(zero, response.arrivals, scene.bands(), band);
    std::vector<double> series = reverberant_series(response, zero, band, first.diffracted_fraction, bins);
    BandMetrics& of_band = metrics.bands[band];
    of_band = measure_band(series, bins.bin_s, first.direct);
    const BandEnergy all{series, bins.bin_s, first.direct};
    const auto lateral = [&](const AxisWeight& weight) {
      return reverberant_series(response, zero, band, first.diffracted_fraction, bins, &weight);
    };
    if (weights.squared_cosine) {
      const std::vector<double> squared = lateral(*weights.squared_cosine);
      if (!is_missing(metrics.missing, "j_lf")) of_band.j_lf = lateral_fraction(squared, all);
      of_band.lg_db = late_lateral_strength_db(squared, bins.bin_s, kFreeField10m);
    }
    if (weights.cosine && !is_missing(metrics.missing, "j_lfc")) of_band.j_lfc = lateral_fraction(lateral(*weights.cosine), all);
    if (request.stage) add_stage_support(all, metrics.missing, of_band);

    const double bandwidth = scene.bands().edge_hz[band + 1] - scene.bands().edge_hz[band];
    direct_sum += bandwidth * first.direct;
    for (const double energy : series) reverberant_sum += bandwidth * energy;
    bandwidth_sum += bandwidth;
    if (request.speech) after_direct.push_back(std::move(series)), direct.push_back(first.direct);
  }
  add_missing_bands(request, metrics.bands_hz, metrics.bands, metrics.missing);
  if (request.speech)
    metrics.sti = add_speech_transmission(request, metrics.bands_hz, after_direct, direct, bins.bin_s, metrics.bands, metrics.missing);
  metrics.drr_db = level_ratio_db(direct_sum, reverberant_sum);
  if (zero.has_direct) metrics.direct_amplitude = std::sqrt(direct_sum / bandwidth_sum);
  return metrics;
}

}  // namespace earshot
