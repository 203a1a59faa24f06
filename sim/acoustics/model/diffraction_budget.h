// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "sim/acoustics/core/acoustic_config.h"

namespace earshot {

/// Limits on the cost of diffraction.  `on`: all that the config allows.  `automatic`: in proportion to the rays of the late field, so that
/// a preset of few rays stays as fast as it is:
///  - sequences of edges that are tried per pose: 8 per ray, at most 4096 (fast: 512), grown in half as many expansions as rays;
///  - of those, with fewer than 512 rays, one path per ray is worked out, those first that lose least on the way to their last edge;
///  - arrivals that are kept: one per 8 rays, at least 4, at most config.diffraction_paths (fast: 8), since each is filtered in synthesis;
///  - with fewer than 512 rays, listeners in line of sight get the waves of edges near their shadow boundary only, so that no level jumps
///    by 6 dB where sight begins; with more, or `on`, of those near the boundary of a reflection as well (diffraction_paths.h).
/// CPU time per pose at preset fast: about 0.05 ms in two rooms of a house, twice that where many edges are near; with sight less.  Per
/// source 3 to 6 ms.
struct DiffractionBudget {
  explicit DiffractionBudget(const AcousticConfig& config);
  int sequences = 0, expansions = 0, paths = 0;
  bool near_boundary_only = false;  ///< in line of sight: of shadow boundaries only
  int attempts = 0;                 ///< paths per pose that pass the estimate and are worked out: one per ray with fewer than 512 rays
  bool reflections = false;         ///< paths with a reflection on either side of their edges (edge_reflections.h)
  static constexpr std::size_t kMostPanels = 16;
  std::size_t panels = 0;  ///< in the air that have waves to every side: kMostPanels, or 6 if `quick` (early_reflections.h)
  bool quick = false;      ///< with fewer than 512 rays: one point of an edge, not five, decides whether it is visible from the listener
};

}  // namespace earshot
