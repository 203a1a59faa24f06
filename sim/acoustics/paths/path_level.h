// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numbers>
#include <span>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// The frequency at which paths over edges are estimated and ranked before they are worked out.
inline constexpr double kRankingHz = 500;

/// Level of an amplitude; -240 dB and less count as that.
inline double level_db(double amplitude) { return 20.0 * std::log10(std::max(amplitude, 1e-12)); }

/// Level of an arrival, mean over bands, re 1 / (4 pi).
inline double level_db(const Arrival& arrival, int num_bands) {
  double sum = 0;
  for (int band = 0; band < num_bands; ++band) sum += double{arrival.amplitude[band]} * arrival.amplitude[band];
  return level_db(4.0 * std::numbers::pi * std::sqrt(sum / num_bands));
}

/// Pressure per band of a path of `distance_m` whose reflections keep `energy_fraction` of the energy.  False if nothing is left.
inline bool set_amplitude(const AcousticScene& scene, double distance_m, std::span<const double> energy_fraction, Arrival& arrival) {
  bool is_audible = false;
  for (int band = 0; band < scene.num_bands(); ++band) {
    const double air = std::exp(-0.5 * scene.air_energy_per_m()[band] * distance_m);
    arrival.amplitude[band] = static_cast<float>(std::sqrt(energy_fraction[band]) * air / (4.0 * std::numbers::pi * distance_m));
    is_audible = is_audible || arrival.amplitude[band] > 0.f;
  }
  return is_audible;
}

/// Reflection by a mirror of a material, in one band.
struct MirrorReflection {
  double energy_fraction = 0, phase_rad = 0;  ///< phase: of locally reacting walls
};
inline MirrorReflection mirror_reflection(const AcousticScene& scene, std::uint32_t material, int band, double cosine) {
  const double kept = 1.0 - scene.scattering(material)[band];
  if (!scene.surfaces().reacts_locally(material)) return {double{scene.reflectance(material)[band]} * kept, 0};
  const std::complex<double> pressure = scene.surfaces().mirror_pressure(material, band, cosine);
  return {std::norm(pressure) * kept, std::arg(pressure)};
}

}  // namespace earshot
