// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/standard_errors.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/draw_spread.h"
#include "sim/acoustics/metrics/late_errors.h"
#include "sim/acoustics/source_field/source_field.h"

namespace earshot {
namespace {

using BandValue = std::optional<double> BandMetrics::*;
using BandDraws = std::vector<std::vector<BandMetrics>>;  ///< [draw][band]

constexpr int kRepetitions = 8;
/// Least rays of the trace that tells a bias, and what few rays miss.  Without the bias few rays arrive over mirrors: of 64 the late energy
/// may be nil.
constexpr int kBiasRays = 2048;
/// Of the difference to a better response: twice this covers it where that response is itself off by a sixth of it.
constexpr double kOfDifference = 0.6;
constexpr std::array<BandValue, 3> kInteraural{&BandMetrics::iacc, &BandMetrics::iacc_early, &BandMetrics::iacc_late};

/// Of one draw, times `factor`.
std::optional<double> error_of_draws(const BandDraws& draws, std::size_t band, BandValue value, double factor) {
  std::vector<double> values;
  for (const std::vector<BandMetrics>& draw : draws)
    if (draw[band].*value) values.push_back(*(draw[band].*value));
  const std::optional<double> error = spread_of_draws(values);
  return error ? std::optional(*error * factor) : std::nullopt;
}

/// May mirrors bias the trace (AcousticConfig::diffuse_last_segment), and can the estimator without this bias tell?  Behind a wall hardly
/// any of its rays arrives.
bool may_be_biased(const AcousticScene& acoustics, const EnergyResponse& response) {
  const bool in_sight = std::ranges::any_of(response.arrivals, [](const Arrival& arrival) { return arrival.kind == ArrivalKind::direct; });
  return acoustics.config().diffuse_last_segment && (in_sight || !traces_transmission(acoustics));
}

/// The scene with last segments as they are, under the same plan.
AcousticScene without_diffuse_last_segment(const AcousticScene& acoustics) {
  AcousticConfig config = acoustics.config();
  config.diffuse_last_segment = false;
  return {AcousticSurfaces(acoustics.shared_scene(), config, acoustics.surfaces().found()), acoustics.plan()};
}

/// The parameters of a trace with more rays.
std::vector<BandMetrics> trace_with_many_rays(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener) {
  const AcousticScene scene = acoustics.with_rays(std::max(acoustics.config().rays, kBiasRays), acoustics.config().seed + kCarrierStep);
  EnergyResponse response;
  compute_energy_response(scene, candidates, listener, response);
  return measure(scene, response).bands;
}

/// The same without the bias.  Between facing mirrors from photons: rays meet few of the long chains there, and the late decay is theirs.
std::vector<BandMetrics> trace_without_bias(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener) {
  if (!candidates.long_chains()) return trace_with_many_rays(without_diffuse_last_segment(acoustics), candidates, listener);
  EnergyResponse response;
  compute_energy_response(acoustics, candidates, build_source_field(acoustics, candidates).get(), listener, response);
  return measure(acoustics, response).bands;
}

/// Repeats the trace with `rays` and visits each.
void repeat_trace(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener, int rays,
                  const std::function<void(const AcousticScene&, const EnergyResponse&)>& visit) {
  for (int i = 1; i <= kRepetitions; ++i) {
    const AcousticScene scene = acoustics.with_rays(rays, acoustics.config().seed + kCarrierStep * static_cast<std::uint64_t>(i));
    EnergyResponse response;
    compute_energy_response(scene, candidates, listener, response);
    visit(scene, response);
  }
}

/// Noise of the photons: their relative error of T20, a mean over bands and places.
MetricErrors errors_of_field(const AcousticScene& acoustics, const SourceField& field, const EnergyResponse& response) {
  MetricErrors errors;
  for (const BandMetrics& band : measure(acoustics, response).bands) {
    BandMetrics& error = errors.bands.emplace_back();
    if (band.rt60_s) error.rt60_s = *band.rt60_s * field.t20_error();
    if (band.t20_s) error.t20_s = *band.t20_s * field.t20_error();
  }
  return errors;
}

std::vector<BandMetrics> errors_of_batches(const std::vector<BandErrors>& batches) {
  std::vector<BandMetrics> errors;
  for (const BandErrors& of_band : batches) {
    BandMetrics& error = errors.emplace_back();
    error.rt60_s = of_band.t30_error_s ? of_band.t30_error_s : of_band.t20_error_s;
    for (const ErrorEntry& entry : kErrorEntries) error.*entry.value = of_band.*entry.error;
  }
  return errors;
}

/// Correlations of the ears of a response, in the octaves of `config`.
std::vector<BandMetrics> correlations(const AcousticConfig& config, const Rir& ears, double delay_s) {
  return measure_interaural(ears, {.direct_delay_s = delay_s, .low_octave = config.low_octave});
}

/// Errors of IACC: of the mean of repeated traces, in quadrature with the spread of one set of carriers.
std::vector<BandMetrics> interaural_errors(const AcousticConfig& config, const EnergyResponse& response, double delay_s,
                                           const RenderEars& render_ears, const BandDraws& traced, double factor) {
  BandDraws carried;
  Rir ears;
  for (std::uint64_t carriers = 1; carriers <= kRepetitions; ++carriers) {
    render_ears(response, carriers, ears);
    carried.push_back(correlations(config, ears, delay_s));
  }
  std::vector<BandMetrics> errors(carried[0].size());
  for (std::size_t band = 0; band < errors.size(); ++band)
    for (const BandValue value : kInteraural) {
      const std::optional<double> of_trace = error_of_draws(traced, band, value, factor),
                                  of_carriers = error_of_draws(carried, band, value, 1.0);
      if (of_trace && of_carriers) errors[band].*value = std::hypot(*of_trace, *of_carriers);
    }
  return errors;
}

}  // namespace

MetricErrors standard_errors(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field,
                             glm::vec3 listener, const EnergyResponse& response, const ParameterRequest& request,
                             const RenderEars& render_ears) {
  if (field != nullptr) return errors_of_field(acoustics, *field, response);
  MetricErrors errors{.bands = errors_of_batches(late_errors(acoustics, response)), .ears = {}, .sti = std::nullopt};
  const bool has_batches = !errors.bands.empty();
  if ((has_batches && !request.any()) || acoustics.config().rays < kRepetitions || acoustics.config().late == Switch::off) return errors;

  const bool with_ears = request.interaural && render_ears;
  const RoomMetrics of_response = measure(acoustics, response);
  const std::vector<BandMetrics>& measured = of_response.bands;
  const double delay_s = of_response.first_arrival_s.value_or(0.0);
  BandDraws repeated, traced;
  std::vector<double> sti;
  // A bidirectional trace has rays from the source too, which no part of its rays from the listener tells of: it is repeated whole.
  const int rays = acoustics.config().rays / (has_batches ? 1 : kRepetitions);
  const double factor = has_batches ? 1.0 : 1.0 / std::sqrt(double{kRepetitions});  // a trace with all rays spreads less
  repeat_trace(acoustics, candidates, listener, rays, [&](const AcousticScene& scene, const EnergyResponse& of_part) {
    RoomMetrics metrics = measure(scene, of_part, request);
    repeated.push_back(std::move(metrics.bands));
    if (metrics.sti) sti.push_back(*metrics.sti);
    if (!with_ears) return;
    Rir ears;
    render_ears(of_part, 0, ears);
    traced.push_back(correlations(acoustics.config(), ears, delay_s));
  });
  std::vector<BandMetrics> better;
  if (!has_batches)
    better = may_be_biased(acoustics, response) ? trace_without_bias(acoustics, candidates, listener)
                                                : trace_with_many_rays(acoustics, candidates, listener);
  errors.sti = spread_of_draws(sti);
  if (errors.sti) *errors.sti *= factor;
  errors.bands.resize(repeated[0].size());
  for (std::size_t band = 0; band < errors.bands.size(); ++band) {
    const auto set = [&](BandValue value) { errors.bands[band].*value = error_of_draws(repeated, band, value, factor); };
    const auto set_with_bias = [&](BandValue value) {
      set(value);
      std::optional<double>& error = errors.bands[band].*value;
      if (error && better[band].*value && measured[band].*value)
        error = std::hypot(*error, kOfDifference * (*(measured[band].*value) - *(better[band].*value)));
    };
    if (!has_batches) {
      set_with_bias(&BandMetrics::rt60_s);
      for (const ErrorEntry& entry : kErrorEntries) set_with_bias(entry.value);
    }
    for (const RequestedMetricKey& entry : kRequestedMetricKeys)
      if (request.*entry.group) set(entry.value);
  }
  if (with_ears) errors.ears = interaural_errors(acoustics.config(), response, delay_s, render_ears, traced, factor);
  return errors;
}

}  // namespace earshot
