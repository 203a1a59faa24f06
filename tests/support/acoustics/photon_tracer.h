// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>
#include <random>
#include <vector>

#include "tests/support/acoustics/late_field.h"

/// A second opinion: photons in one box or in two boxes that share a wall, in double, with no ray tracer, no connections, no roulette and
/// no code of the product; they are counted by the length of their tracks in a sphere around the listener (docs/explanation/estimators.md,
/// section 2).
namespace earshot::rooms {

struct PhotonRoom {
  glm::dvec3 size_m{5, 4, 3};  // of each box; the second one begins at x = size_m.x
  bool two_rooms = false;
  double absorption = 0.2, scattering = 1;
  double wall_absorption = 0.2, wall_transmission = 0;  // of the shared wall
};

/// Energy that arrives later than the direct sound, mean over a sphere of `radius_m`; time limited to `end_s` at 343 m/s.
inline Sample photon_energy(const PhotonRoom& room, glm::dvec3 source, glm::dvec3 listener, double radius_m, double end_s, int photons) {
  constexpr int batches = 20;
  std::mt19937_64 engine(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  const double volume_m3 = 4.0 / 3.0 * std::numbers::pi * radius_m * radius_m * radius_m;
  std::array<double, batches> energy{};
  for (int photon = 0; photon < photons; ++photon) {
    const double z = 2 * uniform(engine) - 1, angle = 2 * std::numbers::pi * uniform(engine), r = std::sqrt(1 - z * z);
    glm::dvec3 position = source, direction(r * std::cos(angle), r * std::sin(angle), z);
    int box = room.two_rooms && source.x > room.size_m.x ? 1 : 0;
    double left = 1, path_m = 0;
    bool straight = true;  // the direct sound, through walls or not, is not counted
    while (left > 1e-8 && path_m < end_s * 343.0) {
      const glm::dvec3 low(box * room.size_m.x, 0, 0), high = low + room.size_m;
      double step_m = 1e9;
      int axis = 0;
      for (int i = 0; i < 3; ++i) {
        const double wall_m = ((direction[i] > 0 ? high[i] : low[i]) - position[i]) / direction[i];
        if (wall_m < step_m) step_m = wall_m, axis = i;
      }
      if (!straight) {
        const glm::dvec3 to = listener - position;
        const double along = glm::dot(to, direction), half2 = radius_m * radius_m - glm::dot(to, to) + along * along;
        if (half2 > 0) {
          const double half = std::sqrt(half2), track = std::min(along + half, step_m) - std::max(along - half, 0.0);
          if (track > 0) energy[photon % batches] += left * track;
        }
      }
      position += step_m * direction;
      position[axis] = direction[axis] > 0 ? high[axis] : low[axis];
      path_m += step_m;
      const bool shared = room.two_rooms && axis == 0 && (direction.x > 0) == (box == 0);
      const double absorption = shared ? room.wall_absorption : room.absorption, tau = shared ? room.wall_transmission : 0;
      left *= 1 - absorption + tau;
      if (tau > 0 && uniform(engine) * (1 - absorption + tau) < tau) {
        box = 1 - box;
        continue;
      }
      straight = false;
      const double turned = -direction[axis];
      if (uniform(engine) < room.scattering) {
        const double cosine = std::sqrt(uniform(engine)), turn = 2 * std::numbers::pi * uniform(engine),
                     sine = std::sqrt(1 - cosine * cosine);
        direction[axis] = std::copysign(cosine, turned);
        direction[(axis + 1) % 3] = sine * std::cos(turn);
        direction[(axis + 2) % 3] = sine * std::sin(turn);
      } else {
        direction[axis] = turned;
      }
    }
  }
  Sample sample;
  double squares = 0;
  for (double& value : energy) {
    value *= batches / (photons * volume_m3 * 4 * std::numbers::pi);
    sample.mean += value / batches;
    squares += value * value / batches;
  }
  sample.standard_error = std::sqrt(std::max(0.0, squares - sample.mean * sample.mean) / (batches - 1));
  return sample;
}

}  // namespace earshot::rooms
