// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <span>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"

namespace earshot {

/// How often poses went without an effect.
struct EffectCounters {
  std::uint64_t poses = 0;
  std::uint64_t in_sight = 0;              ///< poses with a free line of sight
  std::uint64_t transmission_skipped = 0;  ///< nothing transmits, or the line of sight is free
  std::uint64_t diffraction_skipped = 0;   ///< no edge in the scene's air, or none that matters at this pose
  std::uint64_t early_skipped = 0, late_skipped = 0;
  std::uint64_t field_gathers = 0;  ///< late fields that came from a source field
  void add(const EffectCounters& other);
};

/// Effects computed at a pose.
struct PoseEffects {
  bool in_sight = false, transmission = false, diffraction = false;
};
/// One shadow ray, the only one that decides the line of sight.
PoseEffects decide_pose_effects(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener);
/// The counters of one pose, from what was decided and found there: effects.diffraction is then whether a path over edges matters.
EffectCounters count_effects(const AcousticScene& scene, const PoseEffects& effects, bool gathered);

}  // namespace earshot
