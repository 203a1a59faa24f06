// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/scattered_energy.h"

#include <array>
#include <cmath>

#include "sim/acoustics/core/bands.h"

namespace earshot {
namespace {

bool is_finite(glm::vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool is_finite(const Arrival& arrival, std::size_t num_bands) {
  bool finite = std::isfinite(arrival.distance_m) && is_finite(arrival.direction) && is_finite(arrival.departure);
  for (std::size_t band = 0; band < num_bands; ++band)
    finite = finite && std::isfinite(arrival.amplitude[band]) && std::isfinite(arrival.phase_rad[band]);
  return finite;
}

}  // namespace

std::uint64_t drop_nonfinite(std::size_t num_bands, std::vector<Arrival>& arrivals) {
  return std::erase_if(arrivals, [&](const Arrival& arrival) { return !is_finite(arrival, num_bands); });
}

void add_scattered_energy(std::span<const Arrival> scattered, float speed_of_sound_m_per_s, EnergyHistogram& late) {
  std::array<float, kMaxBands> energy;
  std::array<float, 256> sh{};
  sh[0] = 1.f;
  const auto bands = static_cast<std::size_t>(late.num_bands());
  for (const Arrival& arrival : scattered) {
    for (std::size_t band = 0; band < bands; ++band) energy[band] = arrival.amplitude[band] * arrival.amplitude[band];
    late.add(arrival.distance_m / speed_of_sound_m_per_s, std::span(energy).first(bands),
             std::span(sh).first(static_cast<std::size_t>(late.num_coefficients())));
  }
}

}  // namespace earshot
