// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/rigid_sphere.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/base/errors.h"

namespace earshot {

void rigid_sphere_pressure(double ka, std::span<const double> incidence_rad, std::span<std::complex<double>> pressure, double radii) {
  EARSHOT_EXPECT(incidence_rad.size() == pressure.size() && ka >= 0 && radii > 1);
  if (ka < 1e-9) {  // much smaller than any wavelength: the sphere is not there
    std::fill(pressure.begin(), pressure.end(), 1.0);
    return;
  }
  using Complex = std::complex<double>;
  constexpr Complex i(0, 1);
  // p = sum over m of i^m (2m + 1) P_m(cos) [j_m - j_m' h_m / h_m'] = sum of i^m (2m + 1) P_m(cos) (-i / ka^2) / h_m', by the Wronskian of
  // j and h = j - i y, the outgoing spherical Hankel function.  Upward recursion is stable for h, as y grows.
  Complex current = i * std::exp(-i * ka) / ka;  // h_0
  Complex before = -i * current;                 // h_{-1} = j_{-1} - i y_{-1} = cos / ka - i sin / ka
  // In the field of a point source -i kr exp(i kr) h_m(kr) takes the place of i^m, to which it tends far away.
  const bool near = std::isfinite(radii);
  const double kr = near ? ka * radii : 1.0;
  const Complex to_centre = -i * kr * std::exp(i * kr);
  Complex source = i * std::exp(-i * kr) / kr, source_before = -i * source;  // h_0, h_{-1} of kr
  std::vector<Complex> term;
  Complex power = 1;
  for (int m = 0; m < 10000; ++m) {
    const Complex slope = before - (m + 1.0) / ka * current;
    const Complex incident = near ? to_centre * source : power;
    if (!std::isfinite(std::norm(slope)) || !std::isfinite(std::norm(incident))) break;  // far beyond what counts
    term.push_back(incident * (2.0 * m + 1.0) * (-i / (ka * ka)) / slope);
    if (m > ka && std::abs(term.back()) < 1e-12) break;
    const Complex next = (2.0 * m + 1.0) / ka * current - before;
    before = current;
    current = next;
    const Complex source_next = (2.0 * m + 1.0) / kr * source - source_before;
    source_before = source;
    source = source_next;
    power *= i;
  }
  for (std::size_t point = 0; point < pressure.size(); ++point) {
    const double cosine = std::cos(incidence_rad[point]);
    double legendre_before = 0, legendre = 1;
    Complex sum = 0;
    for (std::size_t m = 0; m < term.size(); ++m) {
      sum += term[m] * legendre;
      const double next = ((2.0 * static_cast<double>(m) + 1.0) * cosine * legendre - static_cast<double>(m) * legendre_before) /
                          (static_cast<double>(m) + 1.0);
      legendre_before = legendre;
      legendre = next;
    }
    pressure[point] = sum;
  }
}

double rigid_sphere_delay(double incidence_rad, double radii) {
  constexpr double quarter = 0.5 * std::numbers::pi;
  if (std::isfinite(radii)) {
    const double horizon = std::acos(std::min(1.0 / radii, 1.0));  // as far as the source sees
    if (incidence_rad <= horizon) return std::sqrt(std::max(radii * radii + 1.0 - 2.0 * radii * std::cos(incidence_rad), 0.0)) - radii;
    return std::sqrt(std::max(radii * radii - 1.0, 0.0)) + incidence_rad - horizon - radii;
  }
  return incidence_rad <= quarter ? -std::cos(incidence_rad) : incidence_rad - quarter;
}

}  // namespace earshot
