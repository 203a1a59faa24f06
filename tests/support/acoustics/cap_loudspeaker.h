// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <optional>
#include <vector>

#include "sim/audio/head/directivity.h"
#include "sim/audio/head/rigid_sphere.h"

namespace earshot {

/// A cone in a small cabinet: a spherical cap that moves as one on a rigid sphere (Aarts and Janssen 2011, J. Audio Eng. Soc. 59,
/// "Comparing sound radiation from a loudspeaker with that from a flexible spherical cap on a rigid sphere").  The sphere has the volume of
/// the cabinet; the cap has the radius of the cone, or, where the cone has broken up and only its middle still moves as one, 3 / k. Rms
/// gain over an octave about the given frequency, 1 in front (-z).
class CapLoudspeaker final : public Directivity {
 public:
  static constexpr int kAngles = 37;  ///< every 5 degrees
  /// bands_hz: octave centres, the only frequencies that have a gain.
  CapLoudspeaker(double cabinet_edge_m, double cone_radius_m, double speed_of_sound_m_per_s, std::vector<float> bands_hz)
      : bands_hz_(std::move(bands_hz)) {
    const double sphere_m = cabinet_edge_m * std::cbrt(3 / (4 * std::numbers::pi));
    for (const float band_hz : bands_hz_) {
      const double k_centre = 2 * std::numbers::pi * band_hz / speed_of_sound_m_per_s;
      const double cap_rad = std::asin(std::min(cone_radius_m, 3 / k_centre) / sphere_m);
      std::array<double, kAngles> energy{};
      for (int third = -4; third <= 4; ++third) {
        const double ka = k_centre * std::exp2(third / 9.0) * sphere_m;
        for (int i = 0; i < kAngles; ++i) energy[i] += std::norm(cap_pressure(ka, i * std::numbers::pi / 36, cap_rad));
      }
      for (int i = kAngles - 1; i >= 0; --i) energy[i] /= energy[0];
      energy_.push_back(energy);
    }
  }

  [[nodiscard]] float pressure(glm::vec3 direction, float frequency_hz) const override {
    const double at = std::acos(std::clamp(-double{direction.z}, -1.0, 1.0)) * 36 / std::numbers::pi;
    const int i = std::min(static_cast<int>(at), kAngles - 2);
    const std::array<double, kAngles>& energy = energy_[band(frequency_hz)];
    return static_cast<float>(std::sqrt(energy[i] + (at - i) * (energy[i + 1] - energy[i])));
  }

 private:
  /// By reciprocity the pressure far away in a direction is that of a plane wave from there, averaged over the cap.
  static std::complex<double> cap_pressure(double ka, double angle_rad, double cap_rad) {
    constexpr int rings = 8, sectors = 16;
    std::vector<double> incidence, weight;
    for (int ring = 0; ring < rings; ++ring) {
      const double polar = cap_rad * (ring + 0.5) / rings;
      for (int sector = 0; sector < sectors; ++sector) {
        const double azimuth = 2 * std::numbers::pi * sector / sectors;
        const double cosine = std::cos(angle_rad) * std::cos(polar) + std::sin(angle_rad) * std::sin(polar) * std::cos(azimuth);
        incidence.push_back(std::acos(std::clamp(cosine, -1.0, 1.0)));
        weight.push_back(std::sin(polar) * std::cos(polar));  // the cap moves along its axis
      }
    }
    std::vector<std::complex<double>> pressure(incidence.size());
    rigid_sphere_pressure(ka, incidence, pressure);
    std::complex<double> sum = 0;
    for (std::size_t i = 0; i < pressure.size(); ++i) sum += weight[i] * pressure[i];
    return sum;
  }
  [[nodiscard]] std::size_t band(float frequency_hz) const {
    std::size_t nearest = 0;
    for (std::size_t b = 0; b < bands_hz_.size(); ++b) {
      if (std::fabs(std::log(bands_hz_[b] / frequency_hz)) < std::fabs(std::log(bands_hz_[nearest] / frequency_hz))) nearest = b;
    }
    return nearest;
  }

  std::vector<float> bands_hz_;
  std::vector<std::array<double, kAngles>> energy_;
};

}  // namespace earshot
