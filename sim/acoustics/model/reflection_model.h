// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/model/acoustic_surfaces.h"

namespace earshot {

/// Reflection and transmission of a surface per band, as the bidirectional tracer uses them (docs/explanation/estimators.md,
/// sections 3 and 5):
///   kept = 1 - alpha + tau; of the kept energy the fraction diffuse = (1 - alpha) s / kept leaves after Lambert, specular = (1 - alpha)(1
///   - s) / kept as from a mirror or in a lobe, transmitted = tau / kept goes straight on.
/// Rows are surfaces.padded_bands() long and end in zeros.
class ReflectionModel {
 public:
  /// transmission: false treats every surface as tight.
  ReflectionModel(const AcousticSurfaces& surfaces, bool transmission);

  [[nodiscard]] const float* kept(std::uint32_t material) const { return row(0, material); }
  [[nodiscard]] const float* diffuse(std::uint32_t material) const { return row(1, material); }
  [[nodiscard]] const float* specular(std::uint32_t material) const { return row(2, material); }
  [[nodiscard]] const float* transmitted(std::uint32_t material) const { return row(3, material); }
  [[nodiscard]] bool transmits(std::uint32_t material) const { return mean_[material].transmitted > 0.f; }

  /// Do specular reflections leave in a lobe?  Otherwise as from a mirror, which no connection can reach.
  [[nodiscard]] bool glossy() const { return lobe_ != nullptr; }
  [[nodiscard]] const SpecularLobe& lobe() const { return *lobe_; }
  /// Value per steradian of the specular part between two directions (unit, away from the surface); 0 for a mirror.
  [[nodiscard]] float specular_value(glm::vec3 normal, glm::vec3 in, glm::vec3 out) const;
  /// Density per steradian of leaving toward `out`, lobe choice included, with the mean over bands of all fractions: the model of the
  /// sampler that weights of strategies are computed from.  Any function of the path would leave the result unbiased.
  [[nodiscard]] float mean_pdf(std::uint32_t material, glm::vec3 normal, glm::vec3 in, glm::vec3 out) const;

 private:
  struct Means {
    float diffuse = 0, specular = 0, transmitted = 0;
  };
  [[nodiscard]] const float* row(std::size_t kind, std::uint32_t material) const {
    return &rows_[(std::size_t{material} * 4 + kind) * stride_];
  }

  std::size_t stride_;
  std::vector<float> rows_;
  std::vector<Means> mean_;
  const SpecularLobe* lobe_;
};

}  // namespace earshot
