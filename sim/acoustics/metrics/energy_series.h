// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "sim/acoustics/response/energy_response.h"

namespace earshot {

/// Energy of one band over time from emission on, arrivals of every kind included: [num_bins] of bin_s.  Energy of a wider bin is spread
/// evenly.
std::vector<double> energy_series(const EnergyResponse& response, int band, double bin_s, int num_bins);

}  // namespace earshot
