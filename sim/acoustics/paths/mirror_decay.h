// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <complex>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Fraction of the energy that leaves a surface as from a mirror.
inline double specular_fraction(const AcousticScene& scene, std::uint32_t material, int band) {
  const auto b = static_cast<std::size_t>(band);
  return double{scene.reflectance(material)[b]} * (1.0 - scene.scattering(material)[b]);
}

/// The same at an angle of incidence with this cosine.
inline double specular_fraction(const AcousticScene& scene, std::uint32_t material, int band, double cosine) {
  if (!scene.surfaces().reacts_locally(material)) return specular_fraction(scene, material, band);
  return std::norm(scene.surfaces().mirror_pressure(material, band, cosine)) *
         (1.0 - scene.scattering(material)[static_cast<std::size_t>(band)]);
}

/// The largest at any angle: of a locally reacting surface that at grazing incidence.
inline double largest_specular_fraction(const AcousticScene& scene, std::uint32_t material, int band) {
  return specular_fraction(scene, material, band, 0.0);
}

/// The decay of the diffuse field about a source, with which long chains of mirrors are compared.
class DiffuseDecay {
 public:
  /// 64 rays from the source measure how open the scene is: energy of rays that escape is lost.
  DiffuseDecay(const AcousticScene& scene, glm::vec3 source);

  /// Do reflections between two materials `gap_m` apart stand out by a decibel where the diffuse field has fallen by 35 dB, the end of T30?
  /// At a path length r the images bring 2 / d R^(r/d) / (4 pi r)^2 per metre, R the mean specular reflectance (of surfaces that reflect by
  /// the angle: at normal incidence), and the diffuse field exp(-k r) / (4 pi V).  Never where a bounce costs more than 40 % of the energy:
  /// there are a few images and no flutter.
  [[nodiscard]] bool exceeded_by(std::uint32_t first, std::uint32_t second, double gap_m) const;

 private:
  const AcousticScene& scene_;
  std::vector<double> loss_per_m_;  // [bands]: -log(1 - mean absorption by area) / mean free path
};

}  // namespace earshot
