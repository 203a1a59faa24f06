// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "sim/acoustics/core/energy_decay.h"

namespace earshot {

/// A response in one octave.
struct OctaveDecay {
  double centre_hz = 0;
  BandMetrics metrics;           ///< g_db is that of the record's own scale
  std::vector<double> level_db;  ///< decay curve, a point every millisecond from the direct sound on, 0 at the first; ends at -80 dB
};

/// Octaves in which rooms are compared: 250 Hz to 4 kHz, as in Chen et al. 2022 (SoundSpaces 2.0), figure 3.
inline constexpr double kLowestComparedHz = 200, kHighestComparedHz = 5000;
/// Below it an octave filter spreads the direct sound over more than the window of the direct sound.
inline constexpr double kLowestDrrHz = 400;

/// Those that the sample rate holds, low to high; noise at the end of a record gives way to the decay before it (noise_tail.h).
/// direct_delay_s: nullopt, the onset.  samples: finite, not silent.  Throws InputError for a rate below 1 kHz.
std::vector<OctaveDecay> octave_decays(std::span<const float> samples, float sample_rate_hz, std::optional<double> direct_delay_s);
/// The same of the mean energy of several records of equal length, as one response under several noises.
std::vector<OctaveDecay> octave_decays(std::span<const std::vector<float>> records, float sample_rate_hz, double direct_delay_s);

}  // namespace earshot
