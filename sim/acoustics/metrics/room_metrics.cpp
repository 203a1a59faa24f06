// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/room_metrics.h"

#include <fmt/format.h>

#include <cmath>

#include "sim/acoustics/metrics/response_series.h"

namespace earshot {
namespace {

/// Weights of the lateral parameters; null where a response does not have them.
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

void check_stage(const EnergyResponse& response, const TimeZero& zero, double length_s, std::vector<MissingParameter>& missing) {
  if (!zero.has_direct) {
    for (const char* key : {"st_early_db", "st_late_db"}) missing.push_back({key, "needs a line of sight between source and listener"});
    return;
  }
  for (const Arrival& arrival : response.arrivals) {
    if (arrival.kind != ArrivalKind::direct) continue;
    add_missing_stage(double{arrival.distance_m}, length_s, missing);
    return;
  }
}

}  // namespace

RoomMetrics measure(const AcousticScene& scene, const EnergyResponse& response, const ParameterRequest& request) {
  RoomMetrics metrics;
  metrics.bands_hz = scene.bands().centre_hz;
  const TimeZero zero(response, scene.speed_of_sound_m_per_s());
  if (zero.has_direct) metrics.direct_delay_s = zero.start_s;
  metrics.bands.resize(scene.num_bands());
  if (!std::isfinite(zero.start_s)) return metrics;  // silence
  metrics.first_arrival_s = zero.start_s;

  const double length_s = scene.config().rir_length_s - zero.start_s;
  const SeriesBins bins = series_bins(response.late.bin_s(), length_s);
  const LateralWeights weights = lateral_weights(request, response, metrics.missing);
  if (request.stage) check_stage(response, zero, length_s, metrics.missing);
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
      of_band.j_lf = lateral_fraction(squared, all);
      of_band.lg_db = late_lateral_strength_db(squared, bins.bin_s, kFreeField10m);
    }
    if (weights.cosine) of_band.j_lfc = lateral_fraction(lateral(*weights.cosine), all);
    if (request.stage && !is_missing(metrics.missing, "st_early_db")) add_stage_support(all, of_band);
    if (is_missing(metrics.missing, "st_late_db")) of_band.st_late_db.reset();

    const double bandwidth = scene.bands().edge_hz[band + 1] - scene.bands().edge_hz[band];
    direct_sum += bandwidth * first.direct;
    for (const double energy : series) reverberant_sum += bandwidth * energy;
    bandwidth_sum += bandwidth;
    if (request.speech) after_direct.push_back(std::move(series)), direct.push_back(first.direct);
  }
  if (request.speech)
    metrics.sti = add_speech_transmission(request, metrics.bands_hz, after_direct, direct, bins.bin_s, metrics.bands, metrics.missing);
  metrics.drr_db = level_ratio_db(direct_sum, reverberant_sum);
  if (zero.has_direct) metrics.direct_amplitude = std::sqrt(direct_sum / bandwidth_sum);
  return metrics;
}

}  // namespace earshot
