// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <span>

namespace earshot {

/// The energy that a longer response would still have brought.
struct MissingEnergy {
  double level_db = -std::numeric_limits<double>::infinity();  ///< re `total`
  bool falls = true;                                           ///< does the energy decay toward the end?
};

/// The power at the end over its rate of decay, or, where it hardly decays (a noise floor, a room without losses), as much as that power
/// brings in the same time again.  energy: bins of bin_s; total: > 0, in the same unit.  Nothing is missing where the last tenth is silent.
MissingEnergy missing_energy(std::span<const double> energy, double bin_s, double total);

}  // namespace earshot
