// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/model/acoustic_surfaces.h"

namespace earshot {

/// Reflection and transmission of a surface per band, as the bidirectional tracer uses them (docs/explanation/estimators.md,
/// sections 3 and 5):
///   kept = 1 - alpha + tau; of the kept energy the fraction diffuse leaves after Lambert, that of each lobe in the lobe, mirror as from a
///   mirror, transmitted = tau / kept goes straight on.
/// With scattering s the reflected part 1 - alpha is divided into s diffuse and 1 - s as from a mirror, or with config.specular_exponent
/// in one lobe, or by lobe_shares.h.  Rows are surfaces.padded_bands() long and end in zeros.
class ReflectionModel {
 public:
  /// A lobe of a material.
  struct Lobe {
    const SpecularLobe* lobe;
    std::size_t row;
    float mean;  ///< of its fraction over bands
  };

  /// transmission: false treats every surface as tight.
  ReflectionModel(const AcousticSurfaces& surfaces, bool transmission);

  [[nodiscard]] const float* kept(std::uint32_t material) const { return row(0, material); }
  [[nodiscard]] const float* diffuse(std::uint32_t material) const { return row(1, material); }
  [[nodiscard]] const float* mirror(std::uint32_t material) const { return row(2, material); }
  [[nodiscard]] const float* transmitted(std::uint32_t material) const { return row(3, material); }
  [[nodiscard]] bool transmits(std::uint32_t material) const { return mean_[material].transmitted > 0.f; }
  /// Does any band reflect as from a mirror, which no connection can reach?
  [[nodiscard]] bool mirrors(std::uint32_t material) const { return mean_[material].mirror > 0.f; }
  /// Lobes in which specular reflections leave; empty: as from a mirror.
  [[nodiscard]] std::span<const Lobe> lobes(std::uint32_t material) const {
    return std::span(lobes_).subspan(first_lobe_[material], first_lobe_[material + 1] - first_lobe_[material]);
  }
  [[nodiscard]] const float* fraction(const Lobe& lobe) const { return &lobe_rows_[lobe.row]; }
  /// Density per steradian of leaving toward `out`, choice of the way included, with the mean over bands of all fractions: the model of
  /// the sampler that weights of strategies are computed from.  Any function of the path would leave the result unbiased.
  [[nodiscard]] float mean_pdf(std::uint32_t material, glm::vec3 normal, glm::vec3 in, glm::vec3 out) const;

 private:
  struct Means {
    float diffuse = 0, mirror = 0, transmitted = 0;
  };
  [[nodiscard]] const float* row(std::size_t kind, std::uint32_t material) const {
    return &rows_[(std::size_t{material} * 4 + kind) * stride_];
  }
  /// Adds a lobe to the last material: what it gets of the reflected part by band, times `reflected_fraction`.
  void add_lobe(const SpecularLobe* lobe, std::span<const float> share, std::span<const float> reflected_fraction);

  std::size_t stride_;
  std::vector<float> rows_, lobe_rows_;
  std::vector<Means> mean_;
  std::vector<Lobe> lobes_;
  std::vector<std::size_t> first_lobe_;  ///< by material, and one past the last
};

}  // namespace earshot
