// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdio>
#include <memory>
#include <span>
#include <vector>

#include "tests/support/acoustics/bidirectional_field.h"
#include "tests/support/acoustics/divided_room.h"
#include "tests/support/acoustics/source_field_cases.h"

/// Levels in rooms with walls between them that are nearly closed.
namespace earshot::slits {

inline const SoundSource kSource{rooms::point(1.1, 1.2, 1.4)};  ///< before the wall

inline double level_db(double energy) { return 10 * std::log10(energy); }

/// Level of the late field by the bidirectional tracer, without cells.  rays: from either end, for a standard error below `error`.
inline double level_by_paths_db(const std::shared_ptr<const Scene>& room, glm::vec3 place, int rays, double error) {
  AcousticConfig config = rooms::bidirectional_config(rays);
  config.rir_length_s = 1.f;
  config.source_bounces = 30;
  const rooms::Sample sample = rooms::bidirectional_field(room, config, kSource, place).total();
  EXPECT_LT(sample.standard_error, error * sample.mean);
  return level_db(sample.mean);
}

/// Levels of the late field behind the wall, by the field with cells of these sizes, against paths: within 3 dB at each place.  error: at
/// most 0.25, which is 1 dB.
inline void expect_levels_of_paths(const std::shared_ptr<const Scene>& room, std::span<const glm::vec3> places,
                                   std::span<const float> cells_m, int rays, double error) {
  std::vector<double> paths_db;
  for (const glm::vec3 place : places) paths_db.push_back(level_by_paths_db(room, place, rays, error));
  for (const float cell_m : cells_m) {
    const source_fields::Field field(room, source_fields::field_config(65'536, cell_m), kSource);
    std::printf("cells of %.2f m:", static_cast<double>(cell_m));
    for (std::size_t i = 0; i < places.size(); ++i) {
      const double field_db = level_db(rooms::total_energy(field.at(places[i])));
      std::printf(" %+.1f", field_db - paths_db[i]);
      EXPECT_NEAR(field_db, paths_db[i], 3.0) << "cells of " << cell_m << " m, place " << i;
    }
    std::printf(" dB\n");
  }
}

}  // namespace earshot::slits
