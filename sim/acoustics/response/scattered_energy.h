// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "sim/acoustics/core/arrival.h"
#include "sim/acoustics/core/energy_histogram.h"

namespace earshot {

/// Takes out arrivals of which a number is not finite: distance, directions, amplitude and phase of the first num_bands bands.  Returns how
/// many.
std::uint64_t drop_nonfinite(std::size_t num_bands, std::vector<Arrival>& arrivals);

/// Energy that panels scatter joins the late field in the place of their images, without a direction.
void add_scattered_energy(std::span<const Arrival> scattered, float speed_of_sound_m_per_s, EnergyHistogram& late);

}  // namespace earshot
