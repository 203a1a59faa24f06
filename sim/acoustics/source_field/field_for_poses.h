// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "sim/acoustics/model/acoustic_scene.h"
#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/source_field/source_field.h"

namespace earshot {

/// Whether `num_poses` responses of one source should read their late part from a SourceField: with `field: on` always, with `field: auto`
/// from kPosesPerSource poses in a scene whose plan calls for a field, with `field: off` never.
bool wants_source_field(const AcousticScene& scene, std::size_t num_poses);

/// The field of the source for so many responses, to hand to compute_energy_response; null where wants_source_field says no.  Cost and
/// errors as build_source_field.
std::shared_ptr<const SourceField> field_for_poses(const AcousticScene& scene, const EarlyCandidates& candidates, std::size_t num_poses,
                                                   const std::function<void(double fraction)>& progress = {});

/// `field` of a config whose scene is made for sources with so many poses each: `automatic` with fewer than kPosesPerSource becomes off, so
/// that the scene is planned without fields.  A source that moves counts as one without poses.
Switch field_switch_for_poses(Switch user_set, std::size_t num_poses);

}  // namespace earshot
