// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/onset.h"

#include <algorithm>
#include <cmath>

#include "sim/acoustics/metrics/signal_energy.h"

namespace earshot {
namespace {

constexpr double kBelowPeak = 0.1;   // 20 dB
constexpr double kAboveNoise = 5.0;  // 14 dB: one sample of Gaussian noise in two million exceeds it
constexpr double kNoiseWindowS = 0.01;

/// Root mean square of the quietest window with sound in it; 0 if the response has no whole window.
double noise_rms(std::span<const float> samples, double sample_rate_hz) {
  const auto window = static_cast<std::size_t>(std::max(1.0, std::round(kNoiseWindowS * sample_rate_hz)));
  double least = 0;
  for (std::size_t begin = 0; begin + window <= samples.size(); begin += window) {
    const double energy = energy_of(samples.subspan(begin, window));
    if (energy > 0 && (least == 0 || energy < least)) least = energy;
  }
  return std::sqrt(least / static_cast<double>(window));
}

}  // namespace

std::optional<std::size_t> find_onset(std::span<const float> samples, double sample_rate_hz) {
  double peak = 0;
  for (const float value : samples) peak = std::max(peak, std::abs(static_cast<double>(value)));
  if (!(peak > 0)) return std::nullopt;
  const double limit = std::clamp(kAboveNoise * noise_rms(samples, sample_rate_hz), kBelowPeak * peak, 0.5 * peak);
  const auto found =
      std::find_if(samples.begin(), samples.end(), [&](float value) { return std::abs(static_cast<double>(value)) >= limit; });
  return static_cast<std::size_t>(found - samples.begin());
}

}  // namespace earshot
