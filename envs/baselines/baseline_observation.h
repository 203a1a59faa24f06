// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>

namespace earshot {

/// Observation of an agent without learning in one step: no pose, no goal, no map.  Spans are those of BatchedEnv, valid until its next
/// step.
struct BaselineObservation {
  std::span<const float> heard = {};  ///< [2, window]: the last second at the left and the right ear; empty: hears nothing
  std::size_t new_samples = 0;        ///< of each ear, at its end: those of the last step
  std::span<const float> depth = {};  ///< [height, width] in [0, 1] of max_depth_m, main camera; empty: sees nothing
  bool collided = false;              ///< in the last step
};

}  // namespace earshot
