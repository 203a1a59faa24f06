// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <numbers>
#include <vector>

#include "sim/acoustics/response/energy_response.h"

/// The deterministic part of a response as a field with phase.
namespace earshot::coherent_field {

/// No rays and no loss in air.
inline AcousticConfig config_with(Switch diffraction) {
  AcousticConfig config;
  config.diffraction = diffraction;
  config.air_absorption = Switch::off;
  config.late = Switch::off;
  config.rays = 0;
  return config;
}

inline std::vector<Arrival> arrivals_of(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener) {
  EnergyResponse response;
  compute_energy_response(scene, candidates, listener, response);
  return response.arrivals;
}
inline std::vector<Arrival> arrivals_of(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener) {
  return arrivals_of(scene, EarlyCandidates(scene, source), listener);
}

/// Coherent sum of all arrivals in a band, at its centre.
inline std::complex<double> pressure(const AcousticScene& scene, const std::vector<Arrival>& arrivals, std::size_t band) {
  std::complex<double> sum = 0;
  const double k = 2 * std::numbers::pi * scene.bands().centre_hz[band] / scene.speed_of_sound_m_per_s();
  for (const Arrival& arrival : arrivals)
    sum += std::polar(double{arrival.amplitude[band]}, arrival.phase_rad[band] - k * arrival.distance_m);
  return sum;
}

}  // namespace earshot::coherent_field
