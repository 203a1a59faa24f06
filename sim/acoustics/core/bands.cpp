// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/bands.h"

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

/// Appends the band [lower_hz, upper_hz] cut at nyquist_hz; a band that starts at or above it is left out.
void append_band(BandLayout& layout, double lower_hz, double centre_hz, double upper_hz, double nyquist_hz) {
  if (lower_hz >= nyquist_hz) return;
  const double cut_hz = std::min(upper_hz, nyquist_hz);
  if (layout.edge_hz.empty()) layout.edge_hz.push_back(static_cast<float>(lower_hz));
  layout.edge_hz.push_back(static_cast<float>(cut_hz));
  layout.centre_hz.push_back(static_cast<float>(upper_hz <= nyquist_hz ? centre_hz : std::sqrt(lower_hz * cut_hz)));
}

}  // namespace

BandLayout BandLayout::octaves(float sample_rate_hz, bool low_octave) {
  BandLayout layout;
  for (int k = low_octave ? -4 : -3; k <= 4; ++k) {
    // Exact midbands and edges of base-ten octaves (IEC 61260-1:2014, eqs. 1 to 5): an octave is a factor 10^0.3.
    const auto at = [k](double offset) { return 1000.0 * std::pow(10.0, 0.3 * (k + offset)); };
    // Less than a third of an octave would be a band of its own for little sound: it belongs to the band below.
    if (at(-1.0 / 6) > 0.5 * sample_rate_hz) break;
    append_band(layout, at(-0.5), at(0.0), at(0.5), 0.5 * sample_rate_hz);
  }
  return layout;
}

BandLayout BandLayout::third_octaves(float sample_rate_hz) {
  BandLayout layout;
  for (int k = -10; k <= 10; ++k) {
    const auto at = [k](double offset) { return 1000.0 * std::pow(10.0, 0.1 * (k + offset)); };
    append_band(layout, at(-0.5), at(0.0), at(0.5), 0.5 * sample_rate_hz);
  }
  return layout;
}

BandLayout BandLayout::log_spaced(int count, float sample_rate_hz) {
  require(count >= 1 && count <= kMaxBands, "bands", count, "must be in [1, 32]");
  // Eight octaves around 125 Hz ... 8 kHz with one below (docs/evidence/oracles.md, O-31): 62.5 / sqrt(2) to 8000 sqrt(2).
  const double lowest_hz = 62.5 / std::sqrt(2.0);
  const auto at = [&](double position) { return lowest_hz * std::exp2(8.0 * position / count); };
  BandLayout layout;
  for (int i = 0; i < count; ++i) append_band(layout, at(i), at(i + 0.5), at(i + 1), 0.5 * sample_rate_hz);
  return layout;
}

}  // namespace earshot
