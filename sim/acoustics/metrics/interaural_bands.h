// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

namespace earshot {

/// Interaural differences in one octave.
struct InterauralBand {
  std::optional<double> ild_db;  ///< level of the left ear over the right one, whole response; nullopt where one is silent
  std::optional<double> iacc;    ///< largest size of the normalised cross-correlation within 1 ms, whole response (interaural.h: total)
  /// Lag of the largest cross-correlation within 1 ms, of the first 80 ms after the direct sound; positive: the left ear hears it first.
  /// nullopt above the octave of 1 kHz, where hearing follows envelopes and not the fine structure that this lag is one of.
  std::optional<double> itd_s;
};

/// left, right: of equal length, at most 2^21 samples.  One entry per octave of BandLayout::octaves(sample_rate_hz).  The ears are cut to
/// the window from 2.5 ms before `direct_delay_s` on and then filtered; lags are resolved by a parabola through points an eighth of the
/// band's shortest period apart.  Throws InputError.
std::vector<InterauralBand> interaural_bands(std::span<const float> left, std::span<const float> right, float sample_rate_hz,
                                             double direct_delay_s);

}  // namespace earshot
