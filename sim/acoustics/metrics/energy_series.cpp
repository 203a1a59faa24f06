// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/metrics/energy_series.h"

#include <algorithm>
#include <cstddef>

namespace earshot {

std::vector<double> energy_series(const EnergyResponse& response, int band, double bin_s, int num_bins) {
  std::vector<double> series(static_cast<std::size_t>(num_bins), 0.0);
  for (const Arrival& arrival : response.arrivals) {
    const double position = double{arrival.distance_m} / response.speed_of_sound_m_per_s / bin_s;
    if (position < num_bins) series[static_cast<std::size_t>(position)] += double{arrival.amplitude[band]} * arrival.amplitude[band];
  }
  const EnergyHistogram& late = response.late;
  const double width = late.bin_s() / bin_s;
  for (int bin = 0; bin < late.num_bins(); ++bin) {
    const double energy = late.energy(bin, band), from = bin * width, to = from + width;
    for (auto i = static_cast<int>(from); i < num_bins && i < to; ++i) {
      const double overlap = std::min(to, i + 1.0) - std::max(from, static_cast<double>(i));
      if (overlap > 0) series[static_cast<std::size_t>(i)] += energy * overlap / width;
    }
  }
  return series;
}

}  // namespace earshot
