// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/scene/scene.h"

namespace earshot {

/// Points of the air of a scene: of 16,384 stratified points of its bounds those that have a floor below and belong to the largest region
/// whose points are in line of sight of each other, directly or through others (so not the inside of walls and furniture).
struct AirSample {
  std::vector<glm::vec3> points;
  double fraction_of_bounds = 0;  ///< of the volume of the bounds
};

/// Same scene and seed, same points.  About 0.1 s for 150,000 triangles.
AirSample sample_air(const Scene& scene, std::uint64_t seed);

}  // namespace earshot
