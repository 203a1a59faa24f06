// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>
#include <span>
#include <vector>

/// Decay curves of energy series, on their own: the tests of this folder share no measuring code with the product.
namespace earshot::decay {

/// Energy that is left from the start of each bin on.
inline std::vector<double> curve(std::span<const double> energy) {
  std::vector<double> left(energy.size());
  double sum = 0;
  for (std::size_t i = energy.size(); i-- > 0;) left[i] = sum += energy[i];
  return left;
}

/// Reverberation time from a least-squares line between two levels of the curve, relative to its start.
inline double time_s(std::span<const double> energy, double bin_s, double from_db, double to_db) {
  const std::vector<double> left = curve(energy);
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const double level_db = 10 * std::log10(left[i] / left[0]), t_s = static_cast<double>(i) * bin_s;
    if (level_db > from_db || !(level_db > to_db)) continue;
    n += 1, x += t_s, y += level_db, xx += t_s * t_s, xy += t_s * level_db;
  }
  return n < 3 ? std::nan("") : -60 * (n * xx - x * x) / (n * xy - x * y);
}

/// Level of the curve at a time, relative to its start, interpolated in dB.
inline double level_db(std::span<const double> left, double bin_s, double at_s) {
  const double at = at_s / bin_s;
  const auto i = static_cast<std::size_t>(at);
  const double a = 10 * std::log10(left[i] / left[0]), b = 10 * std::log10(left[i + 1] / left[0]);
  return a + (at - static_cast<double>(i)) * (b - a);
}

/// Energy of a free path, Green units.
inline double direct_energy(double distance_m) {
  const double amplitude = 1 / (4 * std::numbers::pi * distance_m);
  return amplitude * amplitude;
}

/// Mean and its standard error over independent runs.
struct Estimate {
  double mean = 0, standard_error = 0;
};
inline Estimate estimate(std::span<const double> values) {
  double sum = 0, squares = 0;
  for (const double value : values) sum += value;
  const double n = static_cast<double>(values.size()), mean = sum / n;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return {mean, std::sqrt(squares / (n - 1) / n)};
}

}  // namespace earshot::decay
