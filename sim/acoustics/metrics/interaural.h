// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "sim/acoustics/core/bands.h"

namespace earshot {

/// Interaural cross-correlation coefficients (ISO 3382-1:2009, annex B): the largest size of the normalised cross-correlation for lags
/// within 1 ms.  Both ears are cut to the same window before, so that no value exceeds 1.  nullopt where an ear is silent.
struct InterauralCorrelation {
  std::optional<double> total;  ///< from 2.5 ms before the direct sound on (it reaches the near ear before the head's centre)
  std::optional<double> early;  ///< to 80 ms after it
  std::optional<double> late;   ///< from there on
};

/// left, right: of equal length, at most 2^21 samples.  band: index into BandLayout::octaves(sample_rate_hz), or -1 for all frequencies.
/// Lags are resolved to a hundredth of a sample, whatever the rate.
InterauralCorrelation interaural_correlation(std::span<const float> left, std::span<const float> right, float sample_rate_hz,
                                             double direct_delay_s, int band = -1);
/// The same in a band of `bands`, whose filters have edges of twice half_width octaves (octave_filter.h).
InterauralCorrelation interaural_correlation(std::span<const float> left, std::span<const float> right, float sample_rate_hz,
                                             double direct_delay_s, const BandLayout& bands, int band, double half_width);

}  // namespace earshot
