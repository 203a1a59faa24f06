// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <span>

namespace earshot {

/// Evidence that the first ear of each measurement is the left one: the nearer ear is louder and earlier.
struct EarEvidence {
  double level_db = 0;  ///< level of the first ear above the second, half the difference between sources on the left and on the right
  double early_s = 0;   ///< its onset before that of the second, likewise
  /// +1: the first ear is the left one; -1: the right one; 0: level and onset contradict each other, or say too little.
  [[nodiscard]] int first_is_left() const;
};

/// direction: unit, head axes (x right), [measurements].  taps: [measurement][2][num_taps].  delay_samples: [measurement][2].  Measurements
/// nearer than 17 degrees to the median plane are left out.
EarEvidence weigh_ears(std::span<const glm::vec3> direction, std::span<const float> taps, int num_taps,
                       std::span<const float> delay_samples, double sample_rate_hz);

}  // namespace earshot
