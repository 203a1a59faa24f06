// SPDX-License-Identifier: Apache-2.0
#include "tests/support/acoustics/rigid_sheets.h"

#include <gtest/gtest.h>

#include <array>

/// The boundary elements that panels are compared with, against what is known in closed form.
namespace earshot::rigid_sheets {
namespace {

constexpr double kPi = std::numbers::pi;

/// A plane wave, or nearly.
ScatteredField far_source(std::span<const Sheet> sheets, double distance_m, double wavenumber, double per_wave = 9) {
  const std::array<Point, 1> source = {Point(0, distance_m)};
  return {sheets, source, wavenumber, per_wave};
}

TEST(RigidSheets, CylinderIsItsSeries) {
  // Morse and Ingard 1968, section 8.1, for a line source (Bowman and others 1969, section 2.2).  Far from resonances of the inside.
  for (const double ka : {0.4, 1.3, 3.1, 7.3}) {
    Sheet ring;
    for (int i = 0; i <= 48; ++i) ring.emplace_back(std::cos(i * kPi / 24), std::sin(i * kPi / 24));
    const ScatteredField field = far_source(std::array{ring}, 9, ka);
    for (double degrees = 5; degrees < 360; degrees += 23) {
      const double angle = degrees * kPi / 180 - kPi / 2;
      Complex exact = 0;
      for (int n = 0; n < 40; ++n) {
        const auto hankel = [&](int order, double x) { return Complex(::jn(order, x), -::yn(order, x)); };
        const double slope = n == 0 ? -::j1(ka) : 0.5 * (::jn(n - 1, ka) - ::jn(n + 1, ka));
        const Complex outgoing = n == 0 ? -hankel(1, ka) : 0.5 * (hankel(n - 1, ka) - hankel(n + 1, ka));
        const Complex term = slope / outgoing * hankel(n, 9 * ka) * hankel(n, 6 * ka);
        if (!std::isfinite(std::norm(term))) break;
        exact -= Complex(0, -0.25) * (n == 0 ? 1.0 : 2.0) * std::cos(n * angle) * term;
      }
      const Complex found = field.at({6 * std::cos(degrees * kPi / 180), 6 * std::sin(degrees * kPi / 180)});
      // Pieces of 48 chords: their area is that of a circle within 0.3 %, and the ends of each are fine.
      EXPECT_LT(std::abs(found - exact), 0.01 * std::abs(free_field(ka, 15))) << ka << " " << degrees;
    }
  }
}

TEST(RigidSheets, SmallStripIsADipole) {
  // Jump 2 j k sqrt(a^2 - x^2) of the incident pressure (Rayleigh 1897): amplitude pi (k a)^2 / 4 straight back.
  for (const double ka : {0.02, 0.05, 0.1}) {
    const ScatteredField field = far_source(std::array{Sheet{{-1, 0}, {1, 0}}}, 300 / ka, ka);
    const double far_m = 200 / ka;
    const double amplitude = std::abs(field.at({0, far_m}) / free_field(ka, 300 / ka)) * std::sqrt(kPi * ka * far_m / 2);
    EXPECT_NEAR(amplitude / (kPi * ka * ka / 4), 1, 0.01 + 3 * ka * ka);  // the next order is (ka)^2 log(ka)
  }
}

TEST(RigidSheets, WideStripReflectsWhatFallsOnItAndAsMuchAgainIsItsShadow) {
  for (const double ka : {20.0, 40.0}) {
    const ScatteredField field = far_source(std::array{Sheet{{-1, 0}, {1, 0}}}, 1e4, ka);
    double sum = 0;
    const int steps = 1440;
    const double far_m = 400;
    for (int i = 0; i < steps; ++i) {
      const double angle = (i + 0.5) * 2 * kPi / steps;
      sum += std::norm(field.at({far_m * std::cos(angle), far_m * std::sin(angle)})) * 2 * kPi * far_m / steps;
    }
    EXPECT_NEAR(sum / std::norm(free_field(ka, 1e4)) / 4, 1, 0.02);
  }
}

TEST(RigidSheets, RimOfAHalfPlane) {
  // A wide sheet about one rim: Sommerfeld's field, exact for a line source far away; the other rim is 76 waves off.
  const double k = 12;
  const ScatteredField field = far_source(std::array{Sheet{{0, 0}, {40, 0}}}, 3e4, k, 6);
  for (const double degrees : {50., 70., 85., 100., 120., 150.}) {
    // Directions from the sheet; source at 90 degrees.
    const double r = 1.5, phi = degrees * kPi / 180;
    const auto fresnel = [&](double cosine) {  // exp(j k r cos) (1 + erf(...)) / 2, by Simpson from minus infinity along the steepest path
      const double u = std::sqrt(2 * k * r) * cosine;
      Complex tail = 0;  // integral of exp(-j t^2) from |u| on, t = |u| + s exp(-j pi / 4)
      const int steps = 4000;
      const double h = 12.0 / steps;
      for (int i = 0; i <= steps; ++i) {
        const Complex t = std::abs(u) + std::polar(i * h, -kPi / 4);
        tail += (i == 0 || i == steps ? 1.0
                 : i % 2 == 1         ? 4.0
                                      : 2.0) *
                h / 3 * std::exp(Complex(0, -1) * t * t) * std::polar(1.0, -kPi / 4);
      }
      const Complex whole = std::sqrt(kPi) * std::polar(1.0, -kPi / 4);
      return u > 0 ? 1.0 - tail / whole : tail / whole;
    };
    const Complex incident = std::polar(1.0, k * r * std::cos(phi - kPi / 2)), mirrored = std::polar(1.0, k * r * std::cos(phi + kPi / 2));
    const Complex exact = incident * (fresnel(std::cos((phi - kPi / 2) / 2)) - 1.0) + mirrored * fresnel(std::cos((phi + kPi / 2) / 2));
    const Complex found = field.at({r * std::cos(phi), r * std::sin(phi)}) / free_field(k, 3e4);
    EXPECT_LT(std::abs(found - exact), 0.04) << degrees;  // the wave of the other rim: 2 / sqrt(2 pi k 40) of the incident one
  }
}

}  // namespace
}  // namespace earshot::rigid_sheets
