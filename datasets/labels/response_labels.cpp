// SPDX-License-Identifier: Apache-2.0
#include "datasets/labels/response_labels.h"

#include <algorithm>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "datasets/labels/label_number.h"
#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/metrics/standard_errors.h"
#include "sim/acoustics/source_field/source_field.h"

namespace earshot {
namespace {

constexpr int kDelayDigits = 9;

template <class Get>
nlohmann::ordered_json per_band(const RoomMetrics& metrics, const Get& get) {
  nlohmann::ordered_json values = nlohmann::ordered_json::array();
  for (const BandMetrics& band : metrics.bands) values.push_back(rounded(get(band)));
  return values;
}

}  // namespace

std::optional<double> mid_t20_s(const RoomMetrics& metrics) {
  double sum = 0;
  int count = 0;
  for (std::size_t b = 0; b < metrics.bands.size(); ++b) {
    if (metrics.bands_hz[b] < 400 || metrics.bands_hz[b] > 1250) continue;
    if (!metrics.bands[b].t20_s) return std::nullopt;
    sum += *metrics.bands[b].t20_s;
    ++count;
  }
  return count > 0 ? std::optional(sum / count) : std::nullopt;
}

nlohmann::ordered_json place_label(glm::dvec3 position) { return {position.x, position.y, position.z}; }

bool is_in_sight(const EnergyResponse& response) {
  return std::ranges::any_of(response.arrivals, [](const Arrival& arrival) { return arrival.kind == ArrivalKind::direct; });
}

double direct_delay_s(glm::vec3 source, glm::vec3 listener, const EnergyResponse& response) {
  return static_cast<double>(glm::length(source - listener)) / static_cast<double>(response.speed_of_sound_m_per_s);
}

nlohmann::ordered_json rounded_delay(double seconds) { return rounded(seconds, kDelayDigits); }

void add_metrics(const AcousticScene& acoustics, const EnergyResponse& response, const SourceField* field, nlohmann::ordered_json& line) {
  const RoomMetrics metrics = measure(acoustics, response);
  line["drr_db"] = rounded(metrics.drr_db);
  line["t20_mid_s"] = rounded(mid_t20_s(metrics));
  line["t20_s"] = per_band(metrics, [](const BandMetrics& band) { return band.t20_s; });
  line["rt60_s"] = per_band(metrics, [](const BandMetrics& band) { return band.rt60_s; });
  line["c50_db"] = per_band(metrics, [](const BandMetrics& band) { return band.c50_db; });
  line["field_t20_error"] = field ? rounded(field->t20_error()) : nlohmann::ordered_json(nullptr);
}

void add_errors(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field, glm::vec3 listener,
                const EnergyResponse& response, nlohmann::ordered_json& line) {
  const MetricErrors errors = standard_errors(acoustics, candidates, field, listener, response);
  nlohmann::ordered_json values = nlohmann::ordered_json::array();
  for (const BandMetrics& band : errors.bands) values.push_back(rounded(band.t20_s));
  line["t20_error_s"] = values;
}

}  // namespace earshot
