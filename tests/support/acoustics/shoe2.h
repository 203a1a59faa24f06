// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/support/acoustics/rooms.h"

/// SHOE-2 of docs/evidence/oracles.md, O-3: walls of different materials, octaves 125 Hz to 4 kHz.
namespace earshot::shoe2 {

inline constexpr int kBands = 6;
inline constexpr double kEyringS[kBands] = {0.448657, 0.406253, 0.352781, 0.299104, 0.289844, 0.333082};
/// Lambert walls: decay time and energy of all reflections by radiosity (docs/evidence/oracles.md, O-10).
inline constexpr double kLambertS[kBands] = {0.459677, 0.411276, 0.375107, 0.322330, 0.313950, 0.352225};
inline constexpr double kLambertEnergy[kBands] = {0.00351019, 0.00292738, 0.00239446, 0.00184308, 0.00175498, 0.00211054};
inline constexpr double kAbsorption[6][kBands] = {{.02, .02, .03, .04, .05, .07}, {.35, .25, .18, .12, .07, .04},
                                                  {.29, .10, .05, .04, .07, .09}, {.29, .10, .05, .04, .07, .09},
                                                  {.08, .24, .57, .69, .71, .73}, {.50, .70, .60, .70, .70, .50}};

inline glm::vec3 source() { return rooms::point(2.0, 1.7, 1.5); }
inline glm::vec3 listener() { return rooms::point(5.6, 4.1, 1.2); }

/// Each coefficient constant over its octave.
inline std::shared_ptr<const Scene> room(double scattering) {
  std::array<Material, 6> walls = rooms::uniform_walls(0, scattering);
  for (int wall = 0; wall < 6; ++wall) {
    CoefficientCurve& curve = walls[wall].absorption;
    curve = {};
    for (int band = 0; band < kBands; ++band) {
      const double centre_hz = 1000 * std::pow(10.0, 0.3 * (band - 3));
      for (const double half_octave : {0.708, 1.412}) {
        curve.hz.push_back(static_cast<float>(centre_hz * half_octave));
        curve.value.push_back(static_cast<float>(kAbsorption[wall][band]));
      }
    }
  }
  return rooms::box(8, 6, 3.5, walls);
}

}  // namespace earshot::shoe2
