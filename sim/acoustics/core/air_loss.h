// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "sim/acoustics/core/bands.h"

namespace earshot {

/// Attenuation in air over frequency (ISO 9613-1:1993, eq. 5) with the terms that depend on the air alone worked out
/// (air_absorption.h).  As it stands: no loss.
struct AirCurve {
  double classical = 0;                  ///< of f^2
  double relaxation = 0;                 ///< factor of the two relaxations
  double oxygen = 0, oxygen_hz = 1;      ///< weight and relaxation frequency
  double nitrogen = 0, nitrogen_hz = 1;  ///< likewise
  /// frequency_hz >= 0.
  [[nodiscard]] double db_per_m(double frequency_hz) const {
    // 8.686 is 20 / ln 10 as the standard rounds it.
    const double f2 = frequency_hz * frequency_hz;
    return 8.686 * f2 * (classical + relaxation * (oxygen / (oxygen_hz + f2 / oxygen_hz) + nitrogen / (nitrogen_hz + f2 / nitrogen_hz)));
  }
  friend bool operator==(const AirCurve&, const AirCurve&) = default;
};

/// Loss of sound in the air of a scene: over frequency, and as its paths and late energy have it.
struct AirLoss {
  AirCurve curve;  ///< no loss where air absorption is off in all bands
  /// Energy exponent per band in 1/m: the curve at the centre; 0 where air absorption is off.
  std::array<float, kMaxBands> band_per_m{};
  friend bool operator==(const AirLoss&, const AirLoss&) = default;
};

}  // namespace earshot
