// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/pose_effects.h"

#include <algorithm>

#include "sim/acoustics/paths/line_of_sight.h"

namespace earshot {

void EffectCounters::add(const EffectCounters& other) {
  poses += other.poses;
  in_sight += other.in_sight;
  transmission_skipped += other.transmission_skipped;
  diffraction_skipped += other.diffraction_skipped;
  early_skipped += other.early_skipped;
  late_skipped += other.late_skipped;
  field_gathers += other.field_gathers;
}

PoseEffects decide_pose_effects(const AcousticScene& scene, const EarlyCandidates& candidates, glm::vec3 listener) {
  PoseEffects effects;
  effects.in_sight = in_line_of_sight(scene, candidates.source(), listener);
  effects.transmission = scene.plan().straight_transmission && !effects.in_sight;
  effects.diffraction = candidates.diffraction().size() > 0;
  return effects;
}

EffectCounters count_effects(const AcousticScene& scene, const PoseEffects& effects, bool gathered) {
  const bool late = scene.config().late != Switch::off;
  return {.poses = 1,
          .in_sight = effects.in_sight ? 1u : 0u,
          .transmission_skipped = effects.transmission ? 0u : 1u,
          .diffraction_skipped = effects.diffraction ? 0u : 1u,
          .early_skipped = scene.image_order() == 0 ? 1u : 0u,
          .late_skipped = late ? 0u : 1u,
          .field_gathers = late && gathered ? 1u : 0u};
}

}  // namespace earshot
