// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

namespace earshot {

/// Upper bound of the band count everywhere; lets hot loops keep per-band values in fixed arrays.
inline constexpr int kMaxBands = 32;

/// Frequency bands, low to high; edge_hz has one entry more than centre_hz.  The centre of a band that half the rate cuts is the geometric
/// mean of what is left of it, as that of a whole band is: air then takes from a flat band what it takes at the centre, within 0.1 dB
/// while that is less than 5 dB of a half octave (tests/unit/sim/acoustics/core/bands_test.cpp).
struct BandLayout {
  std::vector<float> edge_hz, centre_hz;
  [[nodiscard]] int size() const { return static_cast<int>(centre_hz.size()); }

  /// Octaves at 125 Hz ... 16 kHz (exact midbands 1000 * 10^(0.3 k)), cut at rate / 2: bands of which less than a third of an octave is
  /// left are dropped, and the last edge is clipped.  16 kHz sound gives seven bands, 44.1 and 48 kHz sound eight.  low_octave: one more
  /// at 63 Hz.
  static BandLayout octaves(float sample_rate_hz, bool low_octave = false);
  /// Third octaves at 100 Hz ... 10 kHz (exact midbands 1000 * 10^(0.1 k), IEC 61260-1:2014), for responses in samples; cut at rate / 2:
  /// bands that start above it are dropped.
  static BandLayout third_octaves(float sample_rate_hz);
  /// `count` bands of equal width in log f from 44.194 to 11313.7 Hz, clipped like third_octaves() (docs/evidence/oracles.md, O-31).  count
  /// in [1, kMaxBands].
  static BandLayout log_spaced(int count, float sample_rate_hz);
};

}  // namespace earshot
