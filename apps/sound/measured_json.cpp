// SPDX-License-Identifier: Apache-2.0
#include "apps/sound/measured_json.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

namespace earshot {
namespace {

using Json = nlohmann::ordered_json;

Json number(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

Json values(const std::vector<OctaveDecay>& decays) {
  Json json = Json::object();
  const auto list = [&](const char* key, std::optional<double> BandMetrics::*value) {
    Json& of_key = json[key] = Json::array();
    for (const OctaveDecay& decay : decays) of_key.push_back(number(decay.metrics.*value));
  };
  list("t20_s", &BandMetrics::t20_s);
  list("edt_s", &BandMetrics::edt_s);
  list("c50_db", &BandMetrics::c50_db);
  list("drr_band_db", &BandMetrics::drr_db);
  return json;
}

Json mean(const ComparedValue& value) { return {{"error", number(value.error)}, {"bias", number(value.bias)}, {"count", value.count}}; }

Json coefficients(const std::vector<FittedCoefficient>& list, double FittedCoefficient::*part) {
  Json json = Json::array();
  for (const FittedCoefficient& coefficient : list) json.push_back(coefficient.*part);
  return json;
}

}  // namespace

Json means_json(const RoomComparison& comparison) {
  return {{"t20_percent", mean(comparison.t20_percent)},
          {"edt_percent", mean(comparison.edt_percent)},
          {"drr_db", mean(comparison.drr_db)},
          {"c50_db", mean(comparison.c50_db)},
          {"decay_curve_db", mean(comparison.decay_db)}};
}

Json comparison_json(const RoomComparison& comparison) {
  Json places = Json::array();
  for (const ComparedPlace& place : comparison.places) {
    Json differences = Json::array(), bands = Json::array();
    for (std::size_t b = 0; b < place.measured.size(); ++b) {
      bands.push_back(place.measured[b].centre_hz);
      differences.push_back(number(decay_difference_db(place.measured[b], place.simulated[b])));
    }
    places.push_back({{"name", place.name},
                      {"distance_m", place.distance_m},
                      {"bands_hz", bands},
                      {"measured", values(place.measured)},
                      {"simulated", values(place.simulated)},
                      {"decay_curve_db", differences}});
  }
  return {{"bands_hz", comparison.bands_hz}, {"mean", means_json(comparison)}, {"places", places}};
}

Json fit_json(const FittedRoom& fitted) {
  Json materials = Json::array();
  for (const FittedMaterial& material : fitted.materials) {
    Json json{{"name", material.name},
              {"absorption", coefficients(material.absorption, &FittedCoefficient::value)},
              {"absorption_standard_error", coefficients(material.absorption, &FittedCoefficient::standard_error)}};
    if (!material.scattering.empty()) {
      json["scattering"] = coefficients(material.scattering, &FittedCoefficient::value);
      json["scattering_standard_error"] = coefficients(material.scattering, &FittedCoefficient::standard_error);
    }
    materials.push_back(std::move(json));
  }
  return {{"bands_hz", fitted.bands_hz},
          {"materials", materials},
          {"misfit_before", fitted.misfit_before},
          {"misfit_after", fitted.misfit_after},
          {"simulations", fitted.simulations}};
}

}  // namespace earshot
