// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>

/// Sound reflected by a rigid plate in Kirchhoff's approximation, by brute force: twice the incident pressure on its face, summed with the
/// derivative of the free field's Green's function (Pierce 1981, Acoustics, section 4.6).  Shares no code with the engine.
namespace earshot::rigid_plate {

/// Plate at y = 0, |x| <= width / 2, |z| <= depth / 2.  Pressure in Green units, phase of the whole way included.
inline std::complex<double> reflected(double width_m, double depth_m, glm::dvec3 source, glm::dvec3 listener, double wavenumber) {
  const double pi = std::numbers::pi, step_m = std::min(2 * pi / wavenumber / 6, 0.05);
  const int nx = static_cast<int>(std::ceil(width_m / step_m)), nz = static_cast<int>(std::ceil(depth_m / step_m));
  const double dx = width_m / nx, dz = depth_m / nz;
  std::complex<double> sum = 0;
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < nz; ++j) {
      const glm::dvec3 at((i + 0.5) * dx - width_m / 2, 0, (j + 0.5) * dz - depth_m / 2);
      const double s = glm::length(at - source), r = glm::length(listener - at);
      sum += 2.0 / (16 * pi * pi * s * r) * (listener.y / r) * std::complex<double>(1 / r, wavenumber) *
             std::polar(dx * dz, -wavenumber * (s + r));
    }
  }
  return sum;
}

/// Mean of the squared pressure over the octave about a frequency.
inline double octave_energy(double width_m, double depth_m, glm::dvec3 source, glm::dvec3 listener, double frequency_hz, double speed) {
  double sum = 0;
  for (int i = 0; i < 9; ++i) {
    const double f = frequency_hz * (std::sqrt(0.5) + (i + 0.5) / 9 * (std::sqrt(2.0) - std::sqrt(0.5)));
    sum += std::norm(reflected(width_m, depth_m, source, listener, 2 * std::numbers::pi * f / speed)) / 9;
  }
  return sum;
}

}  // namespace earshot::rigid_plate
