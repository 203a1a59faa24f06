// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/rir_json.h"

#include <cmath>
#include <vector>

#include "sim/acoustics/core/jackknife.h"
#include "sim/acoustics/metrics/band_metric_keys.h"
#include "sim/acoustics/metrics/late_errors.h"

namespace earshot {
namespace {

/// Twice this covers 95 %; null of fewer than two values.
OrderedJson stated_error(const std::vector<double>& values) {
  const std::optional<double> error = error_of_mean(values);
  return error ? OrderedJson(*error * student_factor(static_cast<double>(values.size()) - 1)) : OrderedJson(nullptr);
}

/// One trace from the listener does not have eight independent parts: up to 256 rays are weighed against each other (population_control.h),
/// which leaves four such populations of the preset `balanced`, and all rays follow one sequence of directions (SphereSequence).
OrderedJson errors_by_repetition(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener) {
  constexpr int batches = 8;
  const AcousticConfig& config = acoustics.config();
  if (config.rays < batches || config.late == Switch::off) return OrderedJson::object();
  const auto num_bands = static_cast<std::size_t>(acoustics.num_bands());
  std::vector<RoomMetrics> metrics;
  for (int batch = 0; batch < batches; ++batch) {
    const AcousticScene scene =
        acoustics.with_rays(config.rays / batches, config.seed + 0x9E3779B97F4A7C15ull * static_cast<std::uint64_t>(batch + 1));
    EnergyResponse response;
    compute_energy_response(scene, candidates, listener, response);
    metrics.push_back(measure(scene, response));
  }
  const auto add = [&](OrderedJson& json, const char* key, std::optional<double> BandMetrics::*value) {
    json[key] = OrderedJson::array();
    for (std::size_t band = 0; band < num_bands; ++band) {
      std::vector<double> values;
      for (const RoomMetrics& of_batch : metrics)
        if (of_batch.bands[band].*value) values.push_back(*(of_batch.bands[band].*value));
      json[key].push_back(stated_error(values));
    }
  };
  OrderedJson json = OrderedJson::object();
  add(json, "rt60_s", &BandMetrics::rt60_s);
  for (const ErrorEntry& entry : kErrorEntries) add(json, entry.key, entry.value);
  return json;
}

/// Noise of the photons: their relative error of T20, a mean over bands and places.
OrderedJson errors_of_field(const AcousticScene& acoustics, const SourceField& field, const EnergyResponse& response) {
  OrderedJson json = {{"rt60_s", OrderedJson::array()}, {"t20_s", OrderedJson::array()}};
  for (const BandMetrics& band : measure(acoustics, response).bands) {
    json["rt60_s"].push_back(band.rt60_s ? OrderedJson(*band.rt60_s * field.t20_error()) : OrderedJson(nullptr));
    json["t20_s"].push_back(band.t20_s ? OrderedJson(*band.t20_s * field.t20_error()) : OrderedJson(nullptr));
  }
  return json;
}

}  // namespace

OrderedJson number_or_null(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? OrderedJson(*value) : OrderedJson(nullptr);
}

OrderedJson metrics_json(const RoomMetrics& metrics) {
  OrderedJson json = OrderedJson::object();
  for (const BandMetricKey& entry : kBandMetricKeys) {
    OrderedJson values = OrderedJson::array();
    for (const auto& band : metrics.bands) values.push_back(number_or_null(band.*entry.value));
    json[entry.key] = values;
  }
  OrderedJson statuses = OrderedJson::array();  // why a decay time is null
  for (const auto& band : metrics.bands) statuses.push_back(name_of(band.decay));
  json["decay"] = statuses;
  json["drr_db"] = number_or_null(metrics.drr_db);
  return json;
}

void add_sample_metrics(const Rir& omni, const Rir& heard, const ListenerLayout& layout, const std::vector<std::string>& names,
                        double delay_s, OrderedJson& json) {
  RoomMetrics metrics = measure(omni.channel(0), omni.sample_rate_hz, delay_s);
  if (layout.kind == ListenerKind::binaural) {
    const RoomMetrics ears = measure(heard, delay_s);
    for (std::size_t band = 0; band < metrics.bands.size(); ++band) {
      metrics.bands[band].iacc = ears.bands[band].iacc;
      metrics.bands[band].iacc_early = ears.bands[band].iacc_early;
      metrics.bands[band].iacc_late = ears.bands[band].iacc_late;
    }
  }
  json["rir"] = metrics_json(metrics);
  if (layout.kind != ListenerKind::binaural && layout.kind != ListenerKind::array) return;
  OrderedJson& channels = json[layout.kind == ListenerKind::binaural ? "ears" : "microphones"] = OrderedJson::object();
  for (std::size_t i = 0; i < names.size(); ++i) {
    OrderedJson channel_metrics = metrics_json(measure(heard.channel(static_cast<int>(i)), heard.sample_rate_hz, delay_s));
    for (const char* key : {"iacc", "iacc_early", "iacc_late"}) channel_metrics.erase(key);
    channels[names[i]] = std::move(channel_metrics);
  }
}

OrderedJson standard_errors_json(const AcousticScene& acoustics, const EarlyCandidates& candidates, const SourceField* field,
                                 glm::vec3 listener, const EnergyResponse& response) {
  if (field != nullptr) return errors_of_field(acoustics, *field, response);
  const std::vector<BandErrors> errors = late_errors(acoustics, response);
  if (errors.empty()) return errors_by_repetition(acoustics, candidates, listener);
  OrderedJson json = {{"rt60_s", OrderedJson::array()}};
  for (const BandErrors& error : errors)
    json["rt60_s"].push_back(number_or_null(error.t30_error_s ? error.t30_error_s : error.t20_error_s));
  for (const ErrorEntry& entry : kErrorEntries) {
    json[entry.key] = OrderedJson::array();
    for (const BandErrors& error : errors) json[entry.key].push_back(number_or_null(error.*entry.error));
  }
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
