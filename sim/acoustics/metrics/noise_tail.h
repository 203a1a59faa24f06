// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace earshot {

/// Where a recorded decay meets the noise of its record, and what follows it.
struct NoiseCut {
  std::size_t bin = 0;        ///< first one that the noise decides
  double noise = 0;           ///< energy per bin
  double energy_per_bin = 0;  ///< of the fitted decay at `bin`
  double ratio_per_bin = 0;   ///< by which the fitted decay falls from one bin to the next, in (0, 1)
};

/// Finds it by the method of Lundeby et al. 1995 (Acustica 81, "Uncertainties of measurements in room acoustics"): noise from the last
/// tenth, a line through the level down to 5 dB above it, where they cross, and again with intervals that follow the decay, until the
/// crossing stays.  nullopt where there is no noise to cut: less than 0.2 s, silence in the last tenth, a level that does not fall, a
/// crossing in the last tenth, or less than 15 dB from the loudest 10 ms to the noise.  energy: bins of bin_s.  O(n).
std::optional<NoiseCut> find_noise(std::span<const double> energy, double bin_s);

/// Puts the fitted decay in the place of all that follows the crossing, as ISO 3382-1:2009, 5.3.3, adds it to the integral.
void replace_noise(const NoiseCut& cut, std::span<double> energy);

}  // namespace earshot
