// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>

#include "sim/acoustics/metrics/standard_errors.h"
#include "sim/acoustics/source_field/source_field.h"
#include "tests/support/acoustics/field_rooms.h"

/// Fields of the preset `fast` against paths, 0.4 m from a door between rooms of different decay.
namespace earshot::field_rooms {

/// Relative differences from paths, means over pairs of rooms.
struct DoorBias {
  double t20 = 0, edt = 0;
  int covered = 0, values = 0;  ///< of T20 and EDT of single fields, by twice the stated error
};

/// Relative change of the mean of T20 and of EDT over `fields` seeds, 0.4 m from the door on the side of the source (-1) or behind it (1),
/// as a mean over `pairs` drawn pairs.  Paths: `rays` from either end.
inline DoorBias door_bias(std::uint32_t pairs, int side, int fields, int rays) {
  DoorBias bias;
  for (std::uint32_t number = 0; number < pairs; ++number) {
    const Pair pair = Pair::door(number);
    const glm::vec3 listener = pair.beside(0.4 * side);
    const auto room = pair.scene();
    AcousticConfig config = acoustic_preset("fast");
    config.air_absorption = config.wall_power = config.diffraction = Switch::off;
    config.bands = 1;
    config.sh_order = 0;
    config.rir_length_s = 1.2f;
    AcousticConfig of_paths = config;
    of_paths.field = Switch::off;
    of_paths.rays = of_paths.source_rays = rays;
    of_paths.source_bounces = 60;
    of_paths.diffuse_last_segment = false;
    BandMetrics truth, error_of_truth;
    {
      const AcousticScene scene(room, of_paths);
      const EarlyCandidates candidates(scene, pair.source());
      EnergyResponse response;
      compute_energy_response(scene, candidates, listener, response);
      truth = measure(scene, response).bands[0];
      error_of_truth = standard_errors(scene, candidates, nullptr, listener, response).bands[0];
    }
    config.field = Switch::on;
    double t20_s = 0, edt_s = 0;
    for (int seed = 1; seed <= fields; ++seed) {
      config.seed = static_cast<std::uint64_t>(seed);
      const AcousticScene scene(room, config);
      const EarlyCandidates candidates(scene, pair.source());
      const auto field = build_source_field(scene, candidates);
      EnergyResponse response;
      compute_energy_response(scene, candidates, field.get(), listener, response);
      const BandMetrics found = measure(scene, response).bands[0];
      const BandMetrics stated = standard_errors(scene, candidates, field.get(), listener, response).bands[0];
      t20_s += found.t20_s.value() / fields;
      edt_s += found.edt_s.value() / fields;
      for (const auto value : {&BandMetrics::t20_s, &BandMetrics::edt_s}) {
        const double error = std::hypot((stated.*value).value_or(0), (error_of_truth.*value).value_or(0));
        bias.covered += std::fabs(*(found.*value) - *(truth.*value)) <= 2 * error ? 1 : 0;
        ++bias.values;
      }
    }
    std::printf("  pair %u: T20 %+.1f %%, EDT %+.1f %%, of paths %.1f and %.1f %%\n", number, 100 * (t20_s / *truth.t20_s - 1),
                100 * (edt_s / *truth.edt_s - 1), 100 * error_of_truth.t20_s.value_or(0) / *truth.t20_s,
                100 * error_of_truth.edt_s.value_or(0) / *truth.edt_s);
    bias.t20 += (t20_s / *truth.t20_s - 1) / pairs;
    bias.edt += (edt_s / *truth.edt_s - 1) / pairs;
  }
  std::printf("side %+d: T20 %+.2f %%, EDT %+.2f %%, covered %d of %d\n", side, 100 * bias.t20, 100 * bias.edt, bias.covered, bias.values);
  return bias;
}

}  // namespace earshot::field_rooms
