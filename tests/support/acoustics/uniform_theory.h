// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/paths/utd.h"

/// The sum of WedgeDiffraction::ratio in double, against which that of its lanes is known: the same terms, another way to their integral.
namespace earshot::uniform_theory {

/// exp(z^2) - sum of the odd powers (-z)^m / Gamma(m / 2 + 1); terms up to exp(u^2), so three digits are lost at u = 2.5.
inline std::complex<double> scaled_erfc_series(double u) {
  const double x = u * u;  // z^2 = j x
  double term = 2.0 / std::sqrt(std::numbers::pi), real = 0, imaginary = 0;
  for (int m = 0; m < 60; m += 4) {
    // Powers of j: 1, j, -1, -j.
    real += term;
    term *= x / (m + 1.5);
    imaginary += term;
    term *= x / (m + 2.5);
    real -= term;
    term *= x / (m + 3.5);
    imaginary -= term;
    term *= x / (m + 4.5);
    if (term < 1e-16) break;
  }
  const double z = u * std::numbers::sqrt2 / 2;  // both parts
  return {std::cos(x) - z * (real - imaginary), std::sin(x) - z * (real + imaginary)};
}

/// Laplace's continued fraction 1 / (sqrt(pi) (z + (1/2) / (z + (2/2) / (z + ...)))), from the inside out.
inline std::complex<double> scaled_erfc_fraction(double u) {
  const std::complex<double> z(u * std::numbers::sqrt2 / 2, u * std::numbers::sqrt2 / 2);
  std::complex<double> value = z;
  for (int i = 60; i >= 1; --i) value = z + 0.5 * i / value;
  return std::numbers::inv_sqrtpi / value;
}

/// exp(z^2) erfc(z) on the ray z = u exp(j pi / 4), u >= 0.  Relative error below 1e-11.
inline std::complex<double> scaled_erfc(double u) { return u < 2.5 ? scaled_erfc_series(u) : scaled_erfc_fraction(u); }

struct FaceFactors {
  double first = 1, second = 1, incidence = 1;
};

/// wave_lengths: k L with L = s s' sin^2(beta) / (s + s').
inline std::complex<double> ratio(const WedgeDiffraction& wedge, double wave_lengths, const FaceFactors& faces = {}) {
  const std::array<double, 4> face = {faces.incidence, faces.incidence, faces.first, faces.second};
  std::complex<double> sum = 0;
  for (std::size_t i = 0; i < 4; ++i) sum += wedge.weight(i) * face[i] * scaled_erfc(std::sqrt(2.0 * wave_lengths) * wedge.boundary(i));
  return sum;
}

}  // namespace earshot::uniform_theory
