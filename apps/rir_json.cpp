#include "apps/rir_json.h"

#include <array>
#include <cmath>
#include <vector>

#include "sim/acoustics/metrics/late_errors.h"

namespace earshot {
namespace {

/// Spread of the mean of `values`; null of fewer than two.
OrderedJson error_of_mean(const std::vector<double>& values) {
  if (values.size() < 2) return nullptr;
  const auto n = static_cast<double>(values.size());
  double mean = 0, square = 0;
  for (const double value : values) mean += value / n;
  for (const double value : values) square += (value - mean) * (value - mean);
  return std::sqrt(square / (n - 1) / n);
}

OrderedJson errors_by_repetition(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener) {
  constexpr int batches = 8;
  const AcousticConfig& config = acoustics.config();
  if (config.rays < batches || config.late == Switch::off) return OrderedJson::object();
  const auto num_bands = static_cast<std::size_t>(acoustics.num_bands());
  std::vector<std::vector<double>> rt60(num_bands), level_db(num_bands);
  for (int batch = 0; batch < batches; ++batch) {
    const AcousticScene scene =
        acoustics.with_rays(config.rays / batches, config.seed + 0x9E3779B97F4A7C15ull * static_cast<std::uint64_t>(batch + 1));
    EnergyResponse response;
    compute_energy_response(scene, candidates, listener, response);
    const RoomMetrics metrics = measure(scene, response);
    for (std::size_t b = 0; b < num_bands; ++b) {
      if (metrics.bands[b].rt60_s) rt60[b].push_back(*metrics.bands[b].rt60_s);
      if (metrics.bands[b].g_db) level_db[b].push_back(*metrics.bands[b].g_db);
    }
  }
  OrderedJson json = {{"rt60_s", OrderedJson::array()}, {"g_db", OrderedJson::array()}};
  for (std::size_t b = 0; b < num_bands; ++b) {
    json["rt60_s"].push_back(error_of_mean(rt60[b]));
    json["g_db"].push_back(error_of_mean(level_db[b]));
  }
  return json;
}

/// Of all energy in one band: arrivals and late.
double energy_of(const EnergyResponse& response, std::size_t band, double late) {
  double energy = late;
  for (const Arrival& arrival : response.arrivals) energy += double{arrival.amplitude[band]} * arrival.amplitude[band];
  return energy;
}

}  // namespace

OrderedJson number_or_null(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? OrderedJson(*value) : OrderedJson(nullptr);
}

OrderedJson metrics_json(const RoomMetrics& metrics) {
  struct Entry {
    const char* key;
    std::optional<double> BandMetrics::*value;
  };
  static constexpr std::array<Entry, 13> entries{{{"edt_s", &BandMetrics::edt_s},
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
  OrderedJson json = OrderedJson::object();
  for (const auto& entry : entries) {
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

OrderedJson standard_errors_json(const AcousticScene& acoustics, const EarlyCandidates& candidates, glm::vec3 listener,
                                 const EnergyResponse& response) {
  const std::vector<BandErrors> errors = late_errors(acoustics, response);
  if (errors.empty()) return errors_by_repetition(acoustics, candidates, listener);
  OrderedJson json = {
      {"rt60_s", OrderedJson::array()}, {"t20_s", OrderedJson::array()}, {"t30_s", OrderedJson::array()}, {"g_db", OrderedJson::array()}};
  for (std::size_t b = 0; b < errors.size(); ++b) {
    const BandErrors& error = errors[b];
    json["rt60_s"].push_back(number_or_null(error.t30_error_s ? error.t30_error_s : error.t20_error_s));
    json["t20_s"].push_back(number_or_null(error.t20_error_s));
    json["t30_s"].push_back(number_or_null(error.t30_error_s));
    const double energy = energy_of(response, b, error.late_energy);
    json["g_db"].push_back(energy > 0 ? OrderedJson(10.0 / std::log(10.0) * error.late_energy_error / energy) : OrderedJson(nullptr));
  }
  return json;
}

}  // namespace earshot
