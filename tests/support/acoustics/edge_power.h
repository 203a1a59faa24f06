// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

#include "sim/acoustics/core/acoustic_config.h"

namespace earshot {

inline double power_db(double ratio) { return 10.0 * std::log10(ratio); }

/// The factor of walls near a source, in all bands of the default.
inline AcousticConfig wall_power_config() {
  AcousticConfig config;
  config.wall_power = Switch::on;
  config.rir_length_s = 0.2f;
  return config;
}

/// Power beside an edge of two rigid half planes, the angle of the air between them, over that in the free field; the mean over a band and
/// over all directions of plane waves of the squared pressure, by the series of Bessel functions (Macdonald 1902).  around: angle from the
/// first face.
inline double edge_power(double low_hz, double high_hz, double speed_m_per_s, double air_rad, double r_m, double around) {
  constexpr int frequencies = 24, slopes = 24;
  double sum = 0;
  for (int i = 0; i < frequencies; ++i)
    for (int j = 0; j < slopes; ++j) {
      const double k = 2 * std::numbers::pi * (low_hz + (i + 0.5) / frequencies * (high_hz - low_hz)) / speed_m_per_s;
      const double cosine = (j + 0.5) / slopes, x = k * r_m * std::sqrt(1 - cosine * cosine);
      double square = std::pow(std::cyl_bessel_j(0.0, x), 2);
      for (int n = 1; n * std::numbers::pi / air_rad < x + 12; ++n)
        square +=
            std::pow(std::cyl_bessel_j(n * std::numbers::pi / air_rad, x), 2) * (1 + std::cos(2 * n * std::numbers::pi / air_rad * around));
      sum += square / (frequencies * slopes);
    }
  return 2 * std::numbers::pi / air_rad * sum;
}

}  // namespace earshot
