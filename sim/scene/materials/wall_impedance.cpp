// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/wall_impedance.h"

#include <algorithm>
#include <cmath>

#include "sim/base/errors.h"

namespace earshot {
namespace {

constexpr double kSoftestAbsorber = 1.566924, kHardest = 1e6;

/// 8 / |z|^2 cos a [|z| + cos 2a / sin a atan(|z| sin a / (1 + |z| cos a)) - cos a ln(1 + 2 |z| cos a + |z|^2)], a the phase of z.
double closed_form(std::complex<double> impedance) {
  const double size = std::abs(impedance), cosine = impedance.real() / size, sine = std::abs(impedance.imag()) / size;
  // sin a in the denominator: its limit at a real impedance.
  const double angle = sine > 1e-6 ? std::atan(size * sine / (1 + size * cosine)) / sine : size / (1 + size * cosine);
  const double bracket = size + (cosine * cosine - sine * sine) * angle - cosine * std::log1p(2 * size * cosine + size * size);
  return 8.0 / (size * size) * cosine * bracket;
}

}  // namespace

std::complex<double> wall_reflection(std::complex<double> impedance, double cosine) {
  return (impedance * cosine - 1.0) / (impedance * cosine + 1.0);
}

double random_incidence_absorption(std::complex<double> impedance) {
  EARSHOT_EXPECT(impedance.real() >= 0);
  const double size = std::abs(impedance);
  if (!(impedance.real() > 0)) return 0;
  // The bracket is (|z| cos a)^3 and more of what it is the difference of: small impedances by the first terms of the integral.
  if (size < 1e-3) {
    const double real = impedance.real();
    return 8.0 * real * (1.0 / 3.0 - 0.5 * real);
  }
  return closed_form(impedance);
}

double impedance_of_absorption(double absorption) {
  if (!(absorption < kLargestLocalAbsorption)) return kSoftestAbsorber;
  double low = std::log(kSoftestAbsorber), high = std::log(kHardest);
  if (!(random_incidence_absorption(kHardest) < absorption)) return kHardest;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (random_incidence_absorption(std::exp(middle)) > absorption ? low : high) = middle;
  }
  return std::exp(0.5 * (low + high));
}

}  // namespace earshot
