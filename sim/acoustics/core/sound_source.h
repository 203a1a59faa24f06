// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>
#include <memory>
#include <span>

#include "sim/acoustics/core/bands.h"
#include "sim/audio/head/directivity.h"

namespace earshot {

/// Where a sound comes from and how it radiates.  A position alone is an omnidirectional point.
struct SoundSource {
  SoundSource(glm::vec3 at) : position(at) {}  // a point is the common case and converts by itself
  glm::vec3 position;
  std::shared_ptr<const Directivity> directivity = nullptr;  ///< null: omnidirectional
  glm::quat orientation{1, 0, 0, 0};                         ///< own axes to world; unit
  /// Sphere over whose volume the source is spread for the late field; 0: a point.  Direct sound and what goes round edges or straight
  /// through walls is that of its visible and hidden parts (sphere_arrivals.h).  Image paths stay those of its centre.
  float radius_m = 0;
};

/// A source's pattern ready for the bands of a scene.
class Emission {
 public:
  Emission(const SoundSource& source, const BandLayout& bands)
      : world_to_local_(glm::conjugate(source.orientation)), pattern_(source.directivity, bands.centre_hz, bands.edge_hz) {}
  [[nodiscard]] bool omnidirectional() const { return pattern_.omnidirectional(); }
  /// Pressure gain per band toward `direction` (unit, world axes), 1 in front: [num_bands].
  void pressure(glm::vec3 direction, std::span<float> gain) const { pattern_.pressure(world_to_local_ * direction, gain); }
  /// Its square: the factor of energy.
  void energy(glm::vec3 direction, std::span<float> gain) const {
    pressure(direction, gain);
    for (float& value : gain) value *= value;
  }

 private:
  glm::quat world_to_local_;
  BandDirectivity pattern_;
};

}  // namespace earshot
