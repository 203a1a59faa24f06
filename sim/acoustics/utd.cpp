#include "sim/acoustics/utd.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;

using Complex = std::complex<double>;

/// a / b for numbers far from overflow: without the checks of std::complex a third of the time.
Complex divide(double a, Complex b) {
  const double scale = a / (b.real() * b.real() + b.imag() * b.imag());
  return {scale * b.real(), -scale * b.imag()};
}

/// exp(z^2) - sum of the odd powers (-z)^m / Gamma(m / 2 + 1); terms up to exp(u^2), so three digits are lost at u = 2.5.
Complex scaled_erfc_series(double u) {
  const double x = u * u;  // z^2 = j x
  double term = 2.0 / std::sqrt(kPi), real = 0, imaginary = 0;
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
Complex scaled_erfc_fraction(double u, int terms) {
  const Complex z(u * std::numbers::sqrt2 / 2, u * std::numbers::sqrt2 / 2);
  Complex value = z;
  for (int n = terms; n >= 1; --n) value = z + divide(0.5 * n, value);
  return divide(1.0 / std::sqrt(kPi), value);
}

}  // namespace

Complex scaled_erfc(double u) {
  if (u < 2.5) return scaled_erfc_series(u);
  // Measured against the series in quadruple precision: below 2e-10.
  return scaled_erfc_fraction(u, u < 4.0 ? 24 : 10);
}

WedgeDiffraction::WedgeDiffraction(double exterior_rad, double source_rad, double listener_rad) {
  const double n = exterior_rad / kPi;
  const double difference = std::abs(source_rad - listener_rad), sum = source_rad + listener_rad;
  // pi -+ (phi - phi'), pi -+ (phi + phi'), each less the multiple of 2 pi n that brings it nearest to zero: N+ and N- of the paper.
  const std::array<double, 4> argument = {kPi - difference, kPi + difference, kPi - sum, kPi + sum};
  for (std::size_t i = 0; i < 4; ++i) {
    const double turn = 2.0 * exterior_rad, from_boundary = argument[i] - turn * std::nearbyint(argument[i] / turn);
    const double half = 0.5 * std::abs(from_boundary);
    boundary_[i] = std::abs(std::sin(half));
    const double slope = half > 1e-9 ? std::sin(half) / std::tan(half / n) : n;
    weight_[i] = (from_boundary < 0 ? 0.5 : -0.5) * slope / n;
  }
}

Complex WedgeDiffraction::ratio(double wave_lengths, double first_face, double second_face, double beyond_end) const {
  const std::array<double, 4> face = {1.0, 1.0, first_face, second_face};
  const double scale = std::sqrt(2.0 * wave_lengths);
  std::array<Complex, 4> term;
  for (std::size_t i = 0; i < 4; ++i) {
    const double weight = weight_[i] * face[i];
    if (weight == 0) continue;
    const double x = scale * boundary_[i];
    term[i] = weight * scaled_erfc(x);
    // Past its end the edge casts no shadow of its own: no jump at its boundaries there.
    if (beyond_end > 0) term[i] *= x / std::hypot(x, beyond_end);
  }
  // Source and listener swapped keep the terms in their places: the same bits.
  Complex sum = term[0] + term[1] + term[2] + term[3];
  if (beyond_end > 0) {
    const Complex end = scaled_erfc(beyond_end);
    sum = {sum.real() * end.real() - sum.imag() * end.imag(), sum.real() * end.imag() + sum.imag() * end.real()};
  }
  return sum;
}

double kurze_anderson_db(double fresnel_number) {
  const double root = std::sqrt(2.0 * kPi * std::max(fresnel_number, 0.0));
  return 5.0 + (root > 1e-6 ? 20.0 * std::log10(root / std::tanh(root)) : 0.0);
}

}  // namespace earshot
