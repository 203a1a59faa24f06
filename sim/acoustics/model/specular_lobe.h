// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <vector>

namespace earshot {

/// Glossy reflection without loss: the max-normalised Phong lobe (Neumann, Neumann and Szirmay-Kalos 1999),
///   g = (n + 2) / (2 pi) cos^n(gamma) / max(cos in, cos out),   gamma: angle to the mirror direction,
/// plus what it loses, given back diffusely (Kelemen and Szirmay-Kalos 2001):
///   (1 - a(in)) (1 - a(out)) / (pi (1 - mean a)),   a: albedo of g, tabulated over the cosine.
/// Reciprocal, and of albedo 1 for every angle (docs/explanation/estimators.md, section 3; O-30).  Immutable; safe from any thread.
///
/// All directions are unit and point away from the surface; `normal` is on their side.
class SpecularLobe {
 public:
  /// exponent >= 1.  Cost: about 50 ms for the table.
  explicit SpecularLobe(float exponent);

  /// Albedo of the Phong lobe alone.
  [[nodiscard]] float phong_albedo(float cosine) const;
  [[nodiscard]] float mean_phong_albedo() const { return mean_albedo_; }  ///< cosine-weighted over the hemisphere
  /// Value per steradian; its integral with the cosine is 1.
  [[nodiscard]] float value(glm::vec3 normal, glm::vec3 in, glm::vec3 out) const;
  /// Density per steradian with which sample() leaves toward `out`; its integral over the hemisphere is 1.
  [[nodiscard]] float pdf(glm::vec3 normal, glm::vec3 in, glm::vec3 out) const;
  /// Direction away from the surface for sound that came along `in`; u, v, w uniform in [0, 1).
  [[nodiscard]] glm::vec3 sample(glm::vec3 normal, glm::vec3 in, float u, float v, float w) const;

 private:
  [[nodiscard]] float compensation_density(float cosine) const;

  float exponent_, mean_albedo_ = 1;
  std::vector<float> albedo_;        ///< at cosines i / (size - 1)
  std::vector<float> cell_density_;  ///< of the compensation, in equal cells of the squared cosine; mean 1
  std::vector<float> cell_end_;      ///< its running integral
};

}  // namespace earshot
