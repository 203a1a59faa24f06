// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/base/random.h"

/// Sounds and responses for tests of transforms and of the convolution of a stream.
namespace earshot::stream_sounds {

/// Uniform in [-1, 1], times exp(-decay i).
inline std::vector<float> noise(std::size_t size, std::uint32_t stream, double decay = 0) {
  const RandomStream random(3, Purpose::test, stream);
  std::vector<float> values(size);
  for (std::size_t i = 0; i < size; ++i)
    values[i] = static_cast<float>((2.0 * random.uniform(static_cast<std::uint32_t>(i)) - 1.0) * std::exp(-decay * static_cast<double>(i)));
  return values;
}

inline SoundClip clip_of(std::vector<float> samples) { return {.name = "test", .sample_rate_hz = 16000.f, .samples = std::move(samples)}; }

/// [2, taps]: two channels that differ.
inline std::vector<float> stereo_rir(int taps, std::uint32_t stream) {
  return noise(2 * static_cast<std::size_t>(taps), stream, 4.0 / taps);
}

}  // namespace earshot::stream_sounds
