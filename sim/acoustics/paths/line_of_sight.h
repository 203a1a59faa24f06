// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>

#include "sim/acoustics/model/acoustic_scene.h"

namespace earshot {

/// Is the straight line between them free?  A pose decides it once, by this one ray: direct sound, transmission and diffraction take the
/// answer as an argument, so that they never contradict each other.  True for source == listener; swapped ends give the same answer.
inline bool in_line_of_sight(const AcousticScene& scene, glm::vec3 source, glm::vec3 listener) {
  return source == listener || !scene.scene().rays().occluded(listener, source);
}

}  // namespace earshot
