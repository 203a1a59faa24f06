// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <glm/vec3.hpp>
#include <numbers>

/// docs/evidence/oracles.md, O-28: real harmonics to order 3 in ACN order, N3D, for seven directions.
namespace earshot::harmonic_table {

/// World direction of an ambisonic azimuth (counter-clockwise from the front) and elevation.
inline glm::vec3 direction_of(double azimuth_deg, double elevation_deg) {
  constexpr double degree = std::numbers::pi / 180.0;
  const double azimuth = azimuth_deg * degree, elevation = elevation_deg * degree;
  const double x = std::cos(elevation) * std::cos(azimuth), y = std::cos(elevation) * std::sin(azimuth), z = std::sin(elevation);
  return {static_cast<float>(-y), static_cast<float>(z), static_cast<float>(-x)};
}

struct TableRow {
  double azimuth_deg, elevation_deg;
  std::array<double, 16> values;
};

// Five decimals.
inline const TableRow kTable[] = {
    {0, 0, {1, 0, 0, 1.73205, 0, 0, -1.11803, 0, 1.93649, 0, 0, 0, 0, -1.62018, 0, 2.09165}},
    {90, 0, {1, 1.73205, 0, 0, 0, 0, -1.11803, 0, -1.93649, -2.09165, 0, -1.62018, 0, 0, 0, 0}},
    {-90, 0, {1, -1.73205, 0, 0, 0, 0, -1.11803, 0, -1.93649, 2.09165, 0, 1.62018, 0, 0, 0, 0}},
    {180, 0, {1, 0, 0, -1.73205, 0, 0, -1.11803, 0, 1.93649, 0, 0, 0, 0, 1.62018, 0, -2.09165}},
    {0, 90, {1, 0, 1.73205, 0, 0, 0, 2.23607, 0, 0, 0, 0, 0, 2.64575, 0, 0, 0}},
    {30,
     20,
     {1, 0.81380, 0.59240, 1.40954, 1.48087, 0.62238, -0.72568, 1.07799, 0.85498, 1.73559, 1.34004, -0.31600, -1.09272, -0.54732, 0.77367,
      0}},
    {-135,
     -35,
     {1, -1.00325, -0.99346, -1.00325, 1.29940, 1.28673, -0.01457, 1.28673, 0, -0.81296, -1.97190, -0.60526, 1.02817, -0.60526, 0,
      0.81296}},
};

}  // namespace earshot::harmonic_table
