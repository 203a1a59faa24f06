// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <numbers>

#include "api/convert.h"
#include "api/room_metrics.h"
#include "api/source_model.h"
#include "earshot/rir.h"
#include "sim/acoustics/metrics/standard_errors.h"
#include "sim/base/errors.h"

namespace earshot::api {

static_assert(static_cast<int>(ArrivalKind::direct) == static_cast<int>(earshot::ArrivalKind::direct) &&
              static_cast<int>(ArrivalKind::reflection) == static_cast<int>(earshot::ArrivalKind::reflection) &&
              static_cast<int>(ArrivalKind::diffraction) == static_cast<int>(earshot::ArrivalKind::diffraction) &&
              static_cast<int>(ArrivalKind::transmission) == static_cast<int>(earshot::ArrivalKind::transmission));

void describe_arrivals(Response::Model& model) {
  const auto& arrivals = model.response.arrivals;
  const auto bands = static_cast<std::size_t>(model.parts.acoustics->num_bands());
  for (const earshot::Arrival& arrival : arrivals) {
    model.amplitudes.insert(model.amplitudes.end(), arrival.amplitude.begin(),
                            arrival.amplitude.begin() + static_cast<std::ptrdiff_t>(bands));
    model.phases.insert(model.phases.end(), arrival.phase_rad.begin(), arrival.phase_rad.begin() + static_cast<std::ptrdiff_t>(bands));
  }
  for (std::size_t i = 0; i < arrivals.size(); ++i) {
    const earshot::Arrival& arrival = arrivals[i];
    model.arrivals.push_back(
        {.kind = static_cast<ArrivalKind>(arrival.kind),
         .order = arrival.order,
         .identity = arrival.identity,
         .delay_s = static_cast<double>(arrival.distance_m) / static_cast<double>(model.response.speed_of_sound_m_per_s),
         .distance_m = static_cast<double>(arrival.distance_m),
         .direction = vec3_of(arrival.direction),
         .departure = vec3_of(arrival.departure),
         .amplitude = std::span(model.amplitudes).subspan(i * bands, bands),
         .phase_rad = std::span(model.phases).subspan(i * bands, bands)});
  }
}

ListenerOrientation orientation_of(double heading_deg, double pitch_deg, double roll_deg) {
  constexpr double degree = std::numbers::pi / 180;
  require(std::isfinite(heading_deg), "heading_deg", heading_deg, "must be finite");
  require(std::isfinite(pitch_deg), "pitch_deg", pitch_deg, "must be finite");
  require(std::isfinite(roll_deg), "roll_deg", roll_deg, "must be finite");
  // A level listener takes the path that keeps the bits of `earshot rir`.
  if (pitch_deg == 0 && roll_deg == 0) return {heading_deg * degree};
  return {heading_deg * degree, pitch_deg * degree, roll_deg * degree};
}

Rir synthesize(RirSynthesizer& synthesizer, const SourceParts& parts, const ListenerOrientation& orientation, glm::vec3 listener,
               const EnergyResponse& response) {
  earshot::Rir rir;
  synthesizer.render(response, orientation, {carrier_key(parts.acoustics->hash(), parts.candidates->source()), listener}, rir);
  return {rir.num_channels, rir.num_samples, static_cast<double>(rir.sample_rate_hz), std::move(rir.samples), rir.channel_mask};
}

const std::vector<Arrival>& Response::arrivals() const { return model_->arrivals; }

LateEnergy Response::late() const {
  const EnergyHistogram& late = model_->response.late;
  return {late.num_bins(), late.num_bands(), late.num_coefficients(), static_cast<double>(late.bin_s()), late.values()};
}

Metrics Response::metrics() const { return metrics_of(earshot::measure(*model_->parts.acoustics, model_->response)); }

Metrics Response::measure(const ParameterOptions& parameters) const {
  ParameterRequest request = request_of(parameters);
  request.lateral_axis = lateral_axis(model_->parts.candidates->source(), model_->listener);
  return metrics_of(earshot::measure(*model_->parts.acoustics, model_->response, request));
}

Metrics Response::standard_errors(const ParameterOptions& parameters, const RenderOptions& ears) const {
  const SourceParts& parts = model_->parts;
  ParameterRequest request = request_of(parameters);
  request.lateral_axis = lateral_axis(parts.candidates->source(), model_->listener);
  RenderEars render_ears;
  if (request.interaural) {
    const ListenerOrientation orientation = orientation_of(ears.heading_deg, ears.pitch_deg, ears.roll_deg);
    const std::uint64_t key = carrier_key(parts.acoustics->hash(), parts.candidates->source());
    render_ears = [&, orientation, key, synthesizer = std::make_shared<RirSynthesizer>(model_->scene->tables("binaural", ears.hrtf))](
                      const EnergyResponse& response, std::uint64_t carriers, earshot::Rir& rir) {
      synthesizer->render(response, orientation, {key ^ (carriers * kCarrierStep), model_->listener}, rir);
    };
  }
  MetricErrors errors = earshot::standard_errors(*parts.acoustics, *parts.candidates, parts.field.get(), model_->listener, model_->response,
                                                 request, render_ears);
  RoomMetrics found;
  found.bands_hz = parts.acoustics->bands().centre_hz;
  found.bands = std::move(errors.bands);
  found.bands.resize(found.bands_hz.size());
  for (std::size_t band = 0; band < std::min(errors.ears.size(), found.bands.size()); ++band) {
    found.bands[band].iacc = errors.ears[band].iacc;
    found.bands[band].iacc_early = errors.ears[band].iacc_early;
    found.bands[band].iacc_late = errors.ears[band].iacc_late;
  }
  found.sti = errors.sti;
  return metrics_of(found);
}

double Response::speed_of_sound_m_per_s() const { return static_cast<double>(model_->response.speed_of_sound_m_per_s); }
double Response::ray_efficiency() const { return model_->response.stats.ray_efficiency(); }

Rir Response::render(const RenderOptions& options) const {
  const std::string& channels = options.channels.empty() ? model_->channels : options.channels;
  const int wanted = model_->scene->harmonics_of(ListenerLayout::named(channels));
  const int have = model_->parts.acoustics->config().sh_order;
  if (wanted > have)
    throw InputError("channels", fmt::format("'{}' needs harmonics of order {}, the response has order {}", channels, wanted, have),
                     "ask for the response with these channels");
  RirSynthesizer synthesizer(model_->scene->tables(channels, options.hrtf));
  return synthesize(synthesizer, model_->parts, orientation_of(options.heading_deg, options.pitch_deg, options.roll_deg), model_->listener,
                    model_->response);
}

}  // namespace earshot::api
