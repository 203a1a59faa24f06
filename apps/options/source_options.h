// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "sim/acoustics/core/sound_source.h"

namespace earshot {

/// Turned by heading (counter-clockwise from -z, seen from above), then pitched up, then rolled clockwise as seen from behind; degrees.
glm::quat orientation_of(double heading_deg, double pitch_deg, double roll_deg);

/// The options that describe how sources radiate.  Each list holds one value for all sources, or one per source.
struct SourceOptions {
  std::vector<std::string> patterns = {"omni"};
  std::vector<double> heading_deg = {0}, pitch_deg = {0}, radius_m = {0};

  void add_to(CLI::App& command);
  /// Source `index` of `count` at `position`.  Throws InputError if a list has neither one value nor `count`.
  [[nodiscard]] SoundSource source(std::size_t index, std::size_t count, glm::vec3 position) const;
};

}  // namespace earshot
