// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <glm/vec3.hpp>
#include <vector>

#include "sim/acoustics/metrics/room_metrics.h"

namespace earshot {

/// A box of mirrors with a corner at the origin, one source and some listeners; walls in the order x0, x1, y0 (floor), y1, z0, z1.
struct ShoeboxRoom {
  glm::dvec3 size_m{0};
  std::vector<float> bands_hz;                    ///< octaves of the sample rate
  std::array<std::vector<double>, 6> absorption;  ///< per wall and band, of energy
  glm::dvec3 source_m{0};
  std::vector<glm::dvec3> listeners_m;
  double speed_of_sound_m_per_s = 343, sample_rate_hz = 16000, length_s = 1.5;
};

/// The exact energy response of the box, as the sum of all its image sources up to the length (Allen and Berkley 1979, with the energies
/// of images in place of their pressures), measured as a rendered response is (room_metrics.h): bins of 1 ms from the direct sound on,
/// arrivals within 2.5 ms count as direct.  O(images): 0.2 s for a million.  Throws InputError.
RoomMetrics measure_images(const ShoeboxRoom& room, std::size_t listener);

/// The pressure of all images at the room's rate: an impulse each, to a sixteenth of a sample, through octave filters whose amplitudes add
/// up to one, times the root of what the walls have left.  Images interfere, so that its measures lie about those of measure_images by as
/// much as those of any waveform must.
std::vector<float> render_images(const ShoeboxRoom& room, std::size_t listener);

}  // namespace earshot
