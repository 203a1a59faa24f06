// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "sim/acoustics/core/acoustic_config.h"

namespace earshot {

/// One way to render, as one row of the study.
struct AccuracyMode {
  std::string sweep;      ///< the varied setting: "preset", "rays", "photons", ...
  std::string value;      ///< of it
  std::string method;     ///< "path tracer", "source field", "bidirectional", or "plan's choice" between the first two
  AcousticConfig config;  ///< one thread; rir_length_s = 0: as long as the scene needs, unless the length is what is varied
  bool is_fast = false;   ///< the preset `fast` itself, as one value of a sweep: not run again
  int pose_stride = 1;    ///< of the poses, which errors are taken at
};

/// Presets, then one sweep per parameter that acts, each about the preset `fast`.  quick: the presets but `high`, and the ends of two
/// sweeps.
std::vector<AccuracyMode> accuracy_modes(bool quick);

}  // namespace earshot
