// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <complex>
#include <limits>
#include <vector>

#include "sim/audio/head/hrtf.h"
#include "tests/support/acoustics/directions.h"

namespace earshot {

/// Unit vector in head axes; azimuth clockwise from the front: positive on the right.
inline glm::vec3 from_right(double azimuth_deg, double elevation_deg = 0) {
  const double azimuth = azimuth_deg * kDegree, elevation = elevation_deg * kDegree;
  return {static_cast<float>(std::sin(azimuth) * std::cos(elevation)), static_cast<float>(std::sin(elevation)),
          static_cast<float>(-std::cos(azimuth) * std::cos(elevation))};
}

struct Ears {
  std::vector<std::complex<float>> left, right;
};
/// Spectra of a head for one direction.
inline Ears ears(const Hrtf& head, glm::vec3 direction, double extra_delay_samples = 0,
                 double distance_m = std::numeric_limits<double>::infinity()) {
  const auto bins = static_cast<std::size_t>(head.fft_size() / 2 + 1);
  Ears result{std::vector<std::complex<float>>(bins), std::vector<std::complex<float>>(bins)};
  head.spectra(direction, result.left, result.right, extra_delay_samples, distance_m);
  return result;
}

}  // namespace earshot
