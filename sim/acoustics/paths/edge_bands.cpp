// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/edge_bands.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace earshot {

std::vector<EdgeBands> edge_bands(const AcousticScene& scene) {
  std::vector<EdgeBands> groups;
  for (int first = 0; first < scene.num_bands(); first += static_cast<int>(kLanes)) {
    const int count = std::min(scene.num_bands() - first, static_cast<int>(kLanes));
    const auto band_of = [&](std::size_t lane) {
      return static_cast<std::size_t>(first) + std::min(lane, static_cast<std::size_t>(count) - 1);
    };
    std::array<double, kLanes> wavenumber;
    Lanes air;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      wavenumber[lane] = 2.0 * std::numbers::pi * scene.bands().centre_hz[band_of(lane)] / scene.speed_of_sound_m_per_s();
      air[lane] = 0.5f * scene.air_energy_per_m()[band_of(lane)];
    }
    groups.push_back({.first = first, .count = count, .wave = WaveLanes(wavenumber), .air_per_m = air, .face = {}});
    for (std::uint32_t material = 0; material < scene.scene().materials().size(); ++material) {
      FaceLanes& face = groups.back().face.emplace_back();
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const std::size_t band = band_of(lane);
        face.reflected[lane] = std::sqrt(scene.reflectance(material)[band] * (1.f - scene.scattering(material)[band]));
        if (scene.plan().straight_transmission) face.transmitted[lane] = std::sqrt(scene.transmission(material)[band]);
      }
    }
  }
  return groups;
}

bool set_bands(const EdgeBands& bands, const ComplexLanes& ratio, double distance_m, Arrival& arrival) {
  const Lanes amplitude = root_of(norm(ratio)) * bands.free_path(distance_m), phase = argument(ratio);
  bool is_audible = false;
  for (int lane = 0; lane < bands.count; ++lane) {
    arrival.amplitude[bands.first + lane] = amplitude[lane];
    arrival.phase_rad[bands.first + lane] = phase[lane];
    is_audible = is_audible || amplitude[lane] > 0.f;
  }
  return is_audible;
}

}  // namespace earshot
