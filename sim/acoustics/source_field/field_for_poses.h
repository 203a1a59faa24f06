#pragma once

#include <cstddef>

#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Whether `num_poses` responses of one source should read their late part from a SourceField: with `field: on` always, with `field: auto`
/// from kPosesPerSource poses in a scene whose plan calls for a field, with `field: off` never.
bool wants_source_field(const AcousticScene& scene, std::size_t num_poses);

}  // namespace earshot
