// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <glm/vec3.hpp>
#include <numbers>
#include <span>

#include "sim/acoustics/core/energy_histogram.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/audio/head/ambisonics.h"

namespace earshot {

/// Adds single images of a source to the late field of a listener, air and the source's pattern included.  No allocation.
class ImageDeposit {
 public:
  ImageDeposit(const AcousticScene& scene, const Emission& emission, EnergyHistogram& histogram)
      : scene_(scene), emission_(emission), histogram_(histogram) {
    while ((order_ + 1) * (order_ + 1) < histogram.num_coefficients()) ++order_;
  }

  /// `kept`: fraction of the energy per band that the reflections keep; `arrival`: unit, toward the image; `departure`: unit, away from the
  /// source.  Nothing after the end of the histogram.
  void add(std::span<const double> kept, double distance_m, glm::dvec3 arrival, glm::dvec3 departure) {
    const auto num_bands = static_cast<std::size_t>(scene_.num_bands());
    const double spread = 1.0 / (16.0 * std::numbers::pi * std::numbers::pi * distance_m * distance_m);
    for (std::size_t b = 0; b < num_bands; ++b) {
      const double air_per_m = double{scene_.air_energy_per_m()[b]};
      energy_[b] = static_cast<float>(kept[b] * spread * (air_per_m > 0 ? std::exp(-air_per_m * distance_m) : 1.0));
    }
    if (!emission_.omnidirectional()) {
      emission_.energy(glm::vec3(departure), std::span(gain_).first(num_bands));
      for (std::size_t b = 0; b < num_bands; ++b) energy_[b] *= gain_[b];
    }
    const auto coefficients = static_cast<std::size_t>(histogram_.num_coefficients());
    spherical_harmonics_n3d(glm::vec3(arrival), order_, std::span(sh_).first(coefficients));
    histogram_.add(static_cast<float>(distance_m / scene_.speed_of_sound_m_per_s()), std::span(energy_).first(num_bands),
                   std::span(sh_).first(coefficients));
  }

 private:
  const AcousticScene& scene_;
  const Emission& emission_;
  EnergyHistogram& histogram_;
  int order_ = 0;
  std::array<float, kMaxBands> energy_{}, gain_{};
  std::array<float, kMaxCoefficients> sh_{};
};

}  // namespace earshot
