// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/synthesis/microphone_wave.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

namespace earshot {

MicrophoneWave::MicrophoneWave(const SynthesisTables& tables, std::size_t index, const Arrival& arrival,
                               const ListenerOrientation& orientation)
    : num_bands_(static_cast<std::size_t>(tables.num_bands)) {
  const Microphone& microphone = tables.layout.microphones[index];
  const float distance_m = std::max(arrival.distance_m, kMinDistanceM);
  const glm::vec3 to_image = distance_m * orientation.world_to_local(arrival.direction) - microphone.position_m;
  const float own_distance_m = glm::length(to_image);
  const glm::vec3 from = own_distance_m > 1e-6f ? to_image / own_distance_m : glm::vec3(0, 0, -1);
  const float spread = distance_m / std::max(own_distance_m, kMinDistanceM);
  tables.patterns[index].pressure(glm::conjugate(microphone.orientation) * from, std::span(amplitude_).first(num_bands_));
  for (std::size_t b = 0; b < num_bands_; ++b) {
    phase_rad_[b] = arrival.phase_rad[b] + (amplitude_[b] < 0 ? std::numbers::pi_v<float> : 0.f);
    amplitude_[b] = std::abs(amplitude_[b]) * spread * arrival.amplitude[b];
  }
  // The difference alone, so that a microphone at the listener's position has the listener's delay to the last bit.
  distance_m_ = static_cast<double>(arrival.distance_m) + static_cast<double>(own_distance_m - distance_m);
}

}  // namespace earshot
