// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/acoustics/core/arrival.h"

namespace earshot {

/// The frequency at which paths over edges are estimated and ranked before they are worked out.
inline constexpr double kRankingHz = 500;

/// Level of an amplitude; -240 dB and less count as that.
inline double level_db(double amplitude) { return 20.0 * std::log10(std::max(amplitude, 1e-12)); }

/// Level of an arrival, mean over bands, re 1 / (4 pi).
inline double level_db(const Arrival& arrival, int num_bands) {
  double sum = 0;
  for (int band = 0; band < num_bands; ++band) sum += double{arrival.amplitude[band]} * arrival.amplitude[band];
  return level_db(4.0 * std::numbers::pi * std::sqrt(sum / num_bands));
}

}  // namespace earshot
