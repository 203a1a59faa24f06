// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "sim/acoustics/model/acoustic_surfaces.h"
#include "sim/base/random.h"

namespace earshot {

/// The random numbers of the effect plan: the same for every seed.  `use` is the third word, one for each purpose of its own.
enum class ProbeUse : std::uint32_t { place = 0, walk = 1, wall_walk = 2, survey = 3, live_walk = 4 };
inline RandomStream probe_stream(ProbeUse use, std::uint32_t item) {
  return RandomStream(0, Purpose::effect_plan, item, static_cast<std::uint32_t>(use));
}

/// Could a listener stand there?  A floor below and the height of a person above it; in is_room also no wall or piece of furniture around
/// it.  Up to 6 rays.
bool has_height(const AcousticSurfaces& surfaces, glm::vec3 point);
bool is_room(const AcousticSurfaces& surfaces, glm::vec3 point);

/// At most 32 points of the air, one in each of 4 x 2 x 4 parts of the bounds where a listener could stand; spread around the scene if a
/// listener cannot stand anywhere.
std::vector<glm::vec3> points_of_air(const AcousticSurfaces& surfaces);

/// A room as six rays along the axes see it: a box with these walls.
struct RoomGuess {
  bool closed = false;             ///< all six hit
  double volume_m3 = 0;            ///< of that box; as large as the bounds allow where it is not closed
  std::vector<double> loss_per_m;  ///< of diffuse sound, energy, nepers, [num_bands], by Eyring, with air
};
RoomGuess guess_room(const AcousticSurfaces& surfaces, glm::vec3 point, std::span<const double> air_energy_per_m);

/// Points of rooms in which the sound may last longer than elsewhere: those where the box that six rays see loses least, if that is less
/// than `below_per_m` in any band, liveliest first and none in sight of one before.  Searched on a grid of 0.8 m, wider where that gives
/// more than 1024 places: rooms of two such steps are not missed.  Up to 6 rays per place.
std::vector<glm::vec3> live_points(const AcousticSurfaces& surfaces, std::span<const double> air_energy_per_m, double below_per_m,
                                   std::size_t most);

}  // namespace earshot
