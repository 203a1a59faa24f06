// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

/// Diffraction of a rigid wedge of finite length by brute force: the line integral of Svensson, Fred and Vanderkooy 1999 (J. Acoust. Soc.
/// Am. 106, 2331-2344, eqs. 15 to 18) in the frequency domain.  Shares no code with the engine.
namespace earshot::finite_wedge {

/// Cylindrical coordinates about the edge, which runs along z.
struct Point {
  double r, angle_rad, z;
};

/// Diffracted pressure of the edge from z = from_m to to_m in Green units, phase of the whole way included.
inline std::complex<double> line_integral(double exterior_rad, const Point& source, const Point& listener, double from_m, double to_m,
                                          double wavenumber) {
  const double pi = std::numbers::pi, nu = pi / exterior_rad;
  const double angles[4] = {pi + source.angle_rad + listener.angle_rad, pi + source.angle_rad - listener.angle_rad,
                            pi - source.angle_rad + listener.angle_rad, pi - source.angle_rad - listener.angle_rad};
  const auto integrand = [&](double z) {
    const double m = std::hypot(source.r, z - source.z), l = std::hypot(listener.r, z - listener.z);
    const double eta = std::acosh(std::max(1.0, (m * l + (z - source.z) * (z - listener.z)) / (source.r * listener.r)));
    double beta = 0;
    for (const double angle : angles) beta += std::sin(nu * angle) / (std::cosh(nu * eta) - std::cos(nu * angle));
    return std::polar(beta / (m * l), -wavenumber * (m + l));
  };
  // About the apex, where the integrand peaks near a boundary, z = apex + size sinh(x): Simpson in x.
  const double apex = (source.z * listener.r + listener.z * source.r) / (source.r + listener.r);
  const double size = 1e-3 * std::min(source.r, listener.r);
  const double low = std::asinh((from_m - apex) / size), high = std::asinh((to_m - apex) / size);
  const int steps = 2 * 10000;
  const double h = (high - low) / steps;
  std::complex<double> sum = 0;
  for (int i = 0; i <= steps; ++i) {
    const double x = low + i * h, weight = i == 0 || i == steps ? 1 : i % 2 == 1 ? 4 : 2;
    sum += weight * size * std::cosh(x) * integrand(apex + size * std::sinh(x));
  }
  return -nu / (4 * pi) * sum * (h / 3) / (4 * pi);
}

/// The same for the whole edge of a half plane without end, with `reflected` as the pressure that its faces reflect: the impulse response
/// of Biot and Tolstoy 1957 (J. Acoust. Soc. Am. 29, 381-391), of which its Laplace transform along path lengths L - i y, where it has no
/// oscillation, is the spectrum.  Angles of source and listener from the lit face, in (0, 2 pi).
inline std::complex<double> half_plane(const Point& source, const Point& listener, double wavenumber, double reflected) {
  const double pi = std::numbers::pi, r = source.r * listener.r, between = source.angle_rad - listener.angle_rad,
               together = source.angle_rad + listener.angle_rad;
  const double shortest_m = std::hypot(source.r + listener.r, source.z - listener.z);
  const auto integrand = [&](double u) {  // y = u^2 / wavenumber
    const double y = u * u / wavenumber;
    const std::complex<double> eta = std::acosh(1.0 - std::complex<double>(y * y, 2 * shortest_m * y) / (2 * r));
    std::complex<double> beta = 0;
    for (const double sign : {-1.0, 1.0}) {
      beta += std::sin(0.5 * (pi + sign * between)) / (std::cosh(0.5 * eta) - std::cos(0.5 * (pi + sign * between)));
      beta += reflected * std::sin(0.5 * (pi + sign * together)) / (std::cosh(0.5 * eta) - std::cos(0.5 * (pi + sign * together)));
    }
    return beta / std::sinh(eta) * std::exp(-u * u) * (2 * u / wavenumber);
  };
  // Near a shadow boundary the integrand peaks at u = 0: u = size sinh(x), midpoints.
  constexpr double size = 1e-2, last = 5;
  constexpr int steps = 60;
  const double h = std::asinh(last / size) / steps;
  std::complex<double> sum = 0;
  for (int i = 0; i < steps; ++i) {
    const double x = (i + 0.5) * h;
    sum += size * std::cosh(x) * h * integrand(size * std::sinh(x));
  }
  // d(path) = -i dy; nu = 1/2.
  return std::complex<double>(0, 1) / (4 * pi * r) * sum * std::polar(1.0, -wavenumber * shortest_m) / (4 * pi);
}

}  // namespace earshot::finite_wedge
