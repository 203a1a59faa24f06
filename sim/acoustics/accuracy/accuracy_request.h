// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <memory>
#include <vector>

#include "sim/acoustics/accuracy/accuracy_target.h"
#include "sim/acoustics/core/acoustic_config.h"
#include "sim/acoustics/core/sound_source.h"
#include "sim/scene/scene.h"

namespace earshot {

/// One source in a scene and places where it is heard.
struct AccuracySite {
  std::shared_ptr<const Scene> scene;
  SoundSource source;
  std::vector<glm::vec3> places;  ///< of listeners, not empty; at most kMaxPlaces of them are tried, evenly spread
};
inline constexpr std::size_t kMaxPlaces = 12;

struct AccuracyRequest {
  AcousticConfig config;  ///< settings that the planner does not choose: switches, length, bins, bands, seed, threads
  AccuracyTarget target;
  std::vector<AccuracySite> sites;  ///< not empty; one choice is to serve all
  double poses = 1;                 ///< responses rendered per source; they share the cost of its field
  double most_ms = 3.6e6;           ///< that these may take on this machine; nothing dearer is taken
};

}  // namespace earshot
