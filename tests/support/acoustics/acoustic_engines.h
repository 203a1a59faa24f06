// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"
#include "sim/acoustics/response/energy_response.h"
#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/rooms.h"

/// The three estimators of the late field, so that a hard case is put to each of them.
namespace earshot::engines {

enum class Engine { path_tracer, bidirectional, field };
inline constexpr std::array<Engine, 3> kEngines = {Engine::path_tracer, Engine::bidirectional, Engine::field};
inline std::string name_of(Engine engine) {
  return engine == Engine::path_tracer ? "path tracer" : engine == Engine::bidirectional ? "bidirectional tracer" : "source field";
}

/// `config` for this engine: as many rays from the source as from the listener; or `photons`, whatever their error.
inline AcousticConfig config_of(Engine engine, AcousticConfig config, int photons = 2048) {
  config.source_rays = engine == Engine::bidirectional ? config.rays : 0;
  config.field = Switch::off;
  config.field_photons = photons;
  config.field_error = 1e-6f;
  return config;
}

/// One source in one scene, heard through one engine.
class Heard {
 public:
  Heard(Engine engine, std::shared_ptr<const Scene> room, const AcousticConfig& config, const SoundSource& source, int photons = 2048)
      : scene(std::move(room), config_of(engine, config, photons)), candidates(scene, source) {
    if (engine == Engine::field) field = build_source_field(scene, candidates);
  }
  [[nodiscard]] EnergyResponse at(glm::vec3 listener) const {
    EnergyResponse response;
    compute_energy_response(scene, candidates, field.get(), listener, response);
    return response;
  }
  void at(glm::vec3 listener, EnergyResponse& response) const {
    compute_energy_response(scene, candidates, field.get(), listener, response);
  }

  AcousticScene scene;
  EarlyCandidates candidates;
  std::shared_ptr<const SourceField> field;
};

inline double late_energy(const EnergyResponse& response, int band = 0) { return rooms::total_energy(response.late, band); }
inline double db(double ratio) { return 10.0 * std::log10(ratio); }

inline std::size_t count(const EnergyResponse& response, ArrivalKind kind) {
  std::size_t number = 0;
  for (const Arrival& arrival : response.arrivals) number += arrival.kind == kind;
  return number;
}

inline bool is_finite(const EnergyResponse& response) {
  for (const float value : response.late.values())
    if (!std::isfinite(value)) return false;
  for (const Arrival& a : response.arrivals) {
    if (!std::isfinite(a.distance_m)) return false;
    for (int axis = 0; axis < 3; ++axis)
      if (!std::isfinite(a.direction[axis]) || !std::isfinite(a.departure[axis])) return false;
    for (std::size_t band = 0; band < a.amplitude.size(); ++band)
      if (!std::isfinite(a.amplitude[band]) || !std::isfinite(a.phase_rad[band])) return false;
  }
  return true;
}

/// Every number finite, nothing dropped on the way, no energy below zero.
inline void expect_sound(const EnergyResponse& response) {
  EXPECT_TRUE(is_finite(response));
  EXPECT_EQ(response.stats.nonfinite_dropped, 0u);
  for (int bin = 0; bin < response.late.num_bins(); ++bin)
    for (int band = 0; band < response.late.num_bands(); ++band) ASSERT_GE(response.late.energy(bin, band), 0.f);
}

/// Every value that exists is finite.
inline void expect_sound(const RoomMetrics& metrics) {
  for (const BandMetrics& band : metrics.bands)
    for (const auto& value :
         {band.edt_s, band.t20_s, band.t30_s, band.rt60_s, band.c50_db, band.c80_db, band.d50, band.ts_s, band.g_db, band.drr_db})
      EXPECT_TRUE(!value || std::isfinite(*value));
}

/// All that is heard of a response, as floats to be compared bit for bit.
inline std::vector<float> bits_of(const EnergyResponse& response) {
  std::vector<float> bits(response.late.values().begin(), response.late.values().end());
  for (const Arrival& arrival : response.arrivals) {
    bits.push_back(static_cast<float>(arrival.kind));
    bits.push_back(arrival.distance_m);
    for (int axis = 0; axis < 3; ++axis) bits.push_back(arrival.direction[axis]);
    bits.insert(bits.end(), arrival.amplitude.begin(), arrival.amplitude.end());
    bits.insert(bits.end(), arrival.phase_rad.begin(), arrival.phase_rad.end());
  }
  return bits;
}
inline bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

/// SHOE-1 with Lambert walls, one band, no air, no image paths.
inline AcousticConfig plain(int rays = 1024) {
  AcousticConfig config = rooms::plain_config();
  config.rays = rays;
  return config;
}

}  // namespace earshot::engines
