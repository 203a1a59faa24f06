// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/diffraction_budget.h"

#include <algorithm>

namespace earshot {

DiffractionBudget::DiffractionBudget(const AcousticConfig& config) {
  if (config.diffraction == Switch::off) return;
  const bool automatic = config.diffraction == Switch::automatic;
  sequences = automatic ? static_cast<int>(std::min(4096.0, 8.0 * std::max(config.rays, 16))) : 4096;
  expansions = automatic ? std::clamp(config.rays / 2, 16, 512) : 512;
  paths = automatic ? std::min(config.diffraction_paths, std::max(4, config.rays / 8)) : config.diffraction_paths;
  near_boundary_only = quick = automatic && config.rays < 512;
  panels = quick ? 6 : kMostPanels;
  reflections = config.diffraction_reflections > 0;
  attempts = quick ? std::max(config.rays, 16) : sequences;
}

}  // namespace earshot
