// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <span>
#include <vector>

#include "sim/audio/dry_sounds/sound_clip.h"
#include "sim/audio/transforms/fft.h"
#include "sim/base/random.h"

/// White noise and its power in third octaves, for tests of sound in motion.
namespace earshot::band_levels {

inline SoundClip white_noise(std::size_t length, float rate_hz, std::uint64_t seed) {
  const RandomStream random(seed, Purpose::sound, 0, 0);
  SoundClip clip{.name = "white", .sample_rate_hz = rate_hz, .samples = std::vector<float>(length)};
  for (std::size_t n = 0; n < length; ++n) clip.samples[n] = 0.1f * static_cast<float>(random.normal2(static_cast<std::uint32_t>(n))[0]);
  return clip;
}

/// Lower edges of third octaves from 100 Hz on, and the end of the last, 7.9 kHz.
inline std::vector<double> third_octave_edges_hz() {
  std::vector<double> edges;
  for (double centre = 100; centre < 6400; centre *= std::cbrt(2.0)) edges.push_back(centre / std::pow(2.0, 1.0 / 6));
  edges.push_back(edges.back() * std::cbrt(2.0));
  edges.push_back(7900);
  return edges;
}

/// Power per third octave of the whole signal under a Hann window.
inline std::vector<double> band_powers(std::span<const float> signal, double rate_hz) {
  RealFft fft(next_power_of_two(static_cast<int>(signal.size())));
  std::vector<float> windowed(signal.size());
  for (std::size_t n = 0; n < signal.size(); ++n) {
    const double turn = 2.0 * std::numbers::pi * (static_cast<double>(n) + 0.5) / static_cast<double>(signal.size());
    windowed[n] = static_cast<float>(0.5 - 0.5 * std::cos(turn)) * signal[n];
  }
  std::vector<std::complex<float>> spectrum(static_cast<std::size_t>(fft.num_bins()));
  fft.forward(windowed, spectrum);
  const std::vector<double> edges = third_octave_edges_hz();
  std::vector<double> power(edges.size() - 1);
  for (std::size_t k = 0; k < spectrum.size(); ++k) {
    const double frequency_hz = static_cast<double>(k) * rate_hz / fft.size();
    const auto above = std::upper_bound(edges.begin(), edges.end(), frequency_hz);
    if (above != edges.begin() && above != edges.end())
      power[static_cast<std::size_t>(above - edges.begin()) - 1] += static_cast<double>(std::norm(spectrum[k]));
  }
  return power;
}

/// Largest difference in dB between two sets of powers.
inline double worst_difference_db(std::span<const double> a, std::span<const double> b) {
  double worst = 0;
  for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::abs(10.0 * std::log10(a[i] / b[i])));
  return worst;
}

}  // namespace earshot::band_levels
