// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "sim/acoustics/core/acoustic_config.h"

/// What tests of the scene cache load with.
namespace earshot::scene_cache_cases {

/// Scenes and sources within milliseconds.
inline AcousticConfig quick() {
  AcousticConfig config;
  config.rays = 8;
  config.early_candidate_rays = 50;
  config.rir_length_s = 0.1f;
  return config;
}

/// A bound that no test reaches.
inline constexpr std::size_t kRoomy = std::size_t{1} << 30;

}  // namespace earshot::scene_cache_cases
