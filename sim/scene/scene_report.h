#pragma once

#include <array>
#include <string>
#include <vector>

#include "sim/scene/scene.h"

namespace earshot {

/// What `earshot scene` prints about the geometry (navigable area is added by the caller).
struct SceneReport {
  std::uint64_t triangles = 0, open_edges = 0;
  ImportReport removed;
  /// Share of 16,384 rays, sent in all directions from points inside the bounds over the floor, that hit something: 1 in a closed room.
  double ray_efficiency = 0;
  double leaked_ray_share = 0;  ///< 1 - ray_efficiency
  double volume_m3 = 0;         ///< enclosed air: from mean ray length if nearly closed, else of the bounds
  double area_m2 = 0;           ///< of all triangles that rays reach
  std::vector<double> rt60_estimate_s;  ///< per octave band 125 Hz ... 8 kHz; Eyring with air; NaN if open
};
SceneReport report_scene(const Scene& scene, std::uint64_t seed = 0);

}  // namespace earshot
