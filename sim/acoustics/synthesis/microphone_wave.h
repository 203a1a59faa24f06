// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <span>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/synthesis/synthesis_tables.h"

namespace earshot {

/// An arrival as a spherical wave from the image of its source, at one microphone of an array: with the distance and direction of that
/// microphone, and what its pattern makes of them.
class MicrophoneWave {
 public:
  MicrophoneWave(const SynthesisTables& tables, std::size_t microphone, const Arrival& arrival, const ListenerOrientation& orientation);
  [[nodiscard]] std::span<const float> amplitude() const { return std::span(amplitude_).first(num_bands_); }
  [[nodiscard]] std::span<const float> phase_rad() const { return std::span(phase_rad_).first(num_bands_); }
  [[nodiscard]] double distance_m() const { return distance_m_; }

 private:
  std::size_t num_bands_;
  double distance_m_;
  std::array<float, kMaxBands> amplitude_, phase_rad_;
};

}  // namespace earshot
