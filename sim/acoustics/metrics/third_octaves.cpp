// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/third_octaves.h"

#include <algorithm>
#include <cmath>

namespace earshot {

BandLayout third_octaves(float sample_rate_hz) {
  const double nyquist_hz = 0.5 * static_cast<double>(sample_rate_hz);
  BandLayout layout;
  for (int k = -10; k <= 10; ++k) {
    // A third octave is a factor 10^0.1.
    const auto at = [k](double offset) { return 1000.0 * std::pow(10.0, 0.1 * (k + offset)); };
    if (at(-0.5) >= nyquist_hz) break;
    if (layout.edge_hz.empty()) layout.edge_hz.push_back(static_cast<float>(at(-0.5)));
    const double upper_hz = std::min(at(0.5), nyquist_hz);
    layout.edge_hz.push_back(static_cast<float>(upper_hz));
    layout.centre_hz.push_back(static_cast<float>(at(0.0) <= upper_hz ? at(0.0) : std::sqrt(at(-0.5) * upper_hz)));
  }
  return layout;
}

}  // namespace earshot
