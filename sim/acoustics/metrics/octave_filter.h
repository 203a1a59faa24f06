// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/acoustics/core/bands.h"

namespace earshot {

/// Amplitude of a zero-phase octave filter: raised-cosine power edges half an octave wide in log frequency, centred on the band edges, so
/// that neighbouring bands are power-complementary.  The top band of a clipped layout has no upper edge.  half_width: half of the width of
/// an edge, in octaves; narrower bands have narrower ones.
inline double octave_gain(const BandLayout& bands, int band, double frequency_hz, double nyquist_hz, double half_width = 0.25) {
  const auto rise = [&](double edge_hz) {
    const double x = (std::log2(frequency_hz / edge_hz) + half_width) / (2.0 * half_width);
    return std::sin(0.5 * std::numbers::pi * std::clamp(x, 0.0, 1.0));
  };
  if (!(frequency_hz > 0)) return 0;
  const double upper_hz = static_cast<double>(bands.edge_hz[static_cast<std::size_t>(band) + 1]);
  const double up = rise(static_cast<double>(bands.edge_hz[static_cast<std::size_t>(band)]));
  const double passed_upper = upper_hz >= 0.999 * nyquist_hz ? 0.0 : rise(upper_hz);
  return up * std::sqrt(std::max(0.0, 1.0 - passed_upper * passed_upper));
}

}  // namespace earshot
