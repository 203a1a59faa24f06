// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/rir_json.h"

#include <cmath>
#include <vector>

#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/late_errors.h"

namespace earshot {

OrderedJson number_or_null(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? OrderedJson(*value) : OrderedJson(nullptr);
}

OrderedJson metrics_json(const RoomMetrics& metrics, const ParameterRequest& request) {
  OrderedJson json = OrderedJson::object();
  const auto add = [&](const char* key, std::optional<double> BandMetrics::*value) {
    OrderedJson values = OrderedJson::array();
    for (const auto& band : metrics.bands) values.push_back(number_or_null(band.*value));
    json[key] = values;
  };
  for (const BandMetricKey& entry : kBandMetricKeys) add(entry.key, entry.value);
  for (const RequestedMetricKey& entry : kRequestedMetricKeys)
    if (request.*entry.group) add(entry.key, entry.value);
  OrderedJson statuses = OrderedJson::array();  // why a decay time is null
  for (const auto& band : metrics.bands) statuses.push_back(name_of(band.decay));
  json["decay"] = statuses;
  json["drr_db"] = number_or_null(metrics.drr_db);
  if (request.speech) json["sti"] = number_or_null(metrics.sti);
  if (!request.any() && metrics.missing.empty()) return json;
  json["missing"] = OrderedJson::object();
  for (const MissingParameter& missing : metrics.missing) json["missing"][missing.key] = missing.reason;
  return json;
}

void add_sample_metrics(const Rir& omni, const Rir& heard, const ListenerLayout& layout, const std::vector<std::string>& names,
                        RirMeasurement how, OrderedJson& json) {
  how.request.lateral = false;
  RoomMetrics metrics = measure(omni.channel(0), omni.sample_rate_hz, how);
  if (layout.kind == ListenerKind::binaural) {
    const std::vector<BandMetrics> ears = measure_interaural(heard, how);
    for (std::size_t band = 0; band < metrics.bands.size(); ++band) {
      metrics.bands[band].iacc = ears[band].iacc;
      metrics.bands[band].iacc_early = ears[band].iacc_early;
      metrics.bands[band].iacc_late = ears[band].iacc_late;
    }
  }
  json["rir"] = metrics_json(metrics, how.request);
  if (layout.kind != ListenerKind::binaural && layout.kind != ListenerKind::array) return;
  OrderedJson& channels = json[layout.kind == ListenerKind::binaural ? "ears" : "microphones"] = OrderedJson::object();
  for (std::size_t i = 0; i < names.size(); ++i) {
    OrderedJson channel_metrics = metrics_json(measure(heard.channel(static_cast<int>(i)), heard.sample_rate_hz, how), how.request);
    for (const char* key : {"iacc", "iacc_early", "iacc_late"}) channel_metrics.erase(key);
    channels[names[i]] = std::move(channel_metrics);
  }
}

OrderedJson standard_errors_json(const MetricErrors& errors, bool has_field, const ParameterRequest& request) {
  OrderedJson json = OrderedJson::object();
  if (errors.bands.empty()) return json;
  const auto add = [&](const char* key, std::optional<double> BandMetrics::*value, const std::vector<BandMetrics>& bands) {
    json[key] = OrderedJson::array();
    for (const BandMetrics& band : bands) json[key].push_back(number_or_null(band.*value));
  };
  add("rt60_s", &BandMetrics::rt60_s, errors.bands);
  for (const ErrorEntry& entry : kErrorEntries) add(entry.key, entry.value, errors.bands);
  if (has_field) return json;
  for (const RequestedMetricKey& entry : kRequestedMetricKeys)
    if (request.*entry.group) add(entry.key, entry.value, errors.bands);
  if (request.speech) json["sti"] = number_or_null(errors.sti);
  if (errors.ears.empty()) return json;
  add("iacc", &BandMetrics::iacc, errors.ears);
  add("iacc_early", &BandMetrics::iacc_early, errors.ears);
  add("iacc_late", &BandMetrics::iacc_late, errors.ears);
  return json;
}

OrderedJson accuracy_json(const AccuracyTarget& target, const AccuracyPlan& plan) {
  const auto errors_json = [](const AccuracyErrors& errors) {
    OrderedJson json = OrderedJson::object();
    for (std::size_t kind = 0; kind < kNumAccuracyKinds; ++kind) {
      const AccuracyUnit& unit = unit_of(static_cast<AccuracyKind>(kind));
      json[std::string(unit.name) + (unit.scale > 1 ? "_pct" : "_db")] = number_or_null(errors[kind] * unit.scale);
    }
    return json;
  };
  const auto choice_json = [&](const AccuracyChoice& choice) {
    return OrderedJson{{"method", choice.method},
                       {"settings", settings_of(choice)},
                       {"predicted", errors_json(choice.predicted)},
                       {"per_source_ms", choice.per_source_ms},
                       {"per_response_ms", choice.per_pose_ms}};
  };
  OrderedJson json = choice_json(plan.choice());
  json["target"] = target.text();
  json["reference_error"] = errors_json(plan.reference_error);
  json["calibration_s"] = plan.calibration_s;
  json["tried"] = OrderedJson::array();
  for (const AccuracyChoice& choice : plan.tried) json["tried"].push_back(choice_json(choice));
  return json;
}

}  // namespace earshot
