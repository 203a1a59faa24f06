// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/finite_edge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/base/random.h"
#include "tests/support/acoustics/finite_wedge.h"
#include "tests/support/acoustics/rooms.h"
#include "tests/support/acoustics/uniform_theory.h"

namespace earshot {
namespace {

using Complex = std::complex<double>;

/// An edge along z from 0, first face along +x, air counterclockwise.
DiffractionEdge edge_of(double exterior_rad, double length_m) {
  DiffractionEdge edge;
  edge.along = {0, 0, 1};
  edge.length_m = length_m;
  edge.face = {1, 0, 0};
  edge.first_normal = {0, 1, 0};
  edge.exterior_rad = exterior_rad;
  const glm::dvec3 second(std::cos(exterior_rad), std::sin(exterior_rad), 0);
  edge.second_normal = glm::cross(second, edge.along);
  return edge;
}

glm::dvec3 cartesian(const finite_wedge::Point& p) { return {p.r * std::cos(p.angle_rad), p.r * std::sin(p.angle_rad), p.z}; }

Complex lane(const ComplexLanes& lanes, std::size_t i) { return {lanes.real[i], lanes.imag[i]}; }

/// Over a free path, with rigid faces.
Complex ratio(const FiniteWedge& wedge, double wavenumber) {
  std::array<double, kLanes> wavenumbers;
  wavenumbers.fill(wavenumber);
  const FaceFactorLanes rigid{.first = all_lanes(1), .second = all_lanes(1), .incidence = all_lanes(1)};
  return lane(wedge.ratio(WaveLanes(wavenumbers), wedge.own_length_m(), rigid), 0);
}

/// The engine's diffracted pressure in Green units, phase of the whole way included.
Complex pressure(const DiffractionEdge& edge, const finite_wedge::Point& source, const finite_wedge::Point& listener, double wavenumber) {
  const FiniteWedge wedge(edge, cartesian(source), cartesian(listener));
  const double apex = (source.z * listener.r + listener.z * source.r) / (source.r + listener.r);
  const double z = std::clamp(apex, 0.0, edge.length_m);
  const double way_m = std::hypot(source.r, z - source.z) + std::hypot(listener.r, z - listener.z);
  const double shortest_m = std::hypot(source.r + listener.r, source.z - listener.z);
  return ratio(wedge, wavenumber) * std::polar(1.0 / (4 * std::numbers::pi * shortest_m), -wavenumber * way_m);
}

TEST(FiniteEdge, TailIsTheIntegralPastItsEnd) {
  // Against the integral on the line t = u + s exp(-j pi / 4), where it falls as a Gaussian.
  for (const double u : {0.0, 0.01, 0.2, 0.7, 1.3, 2.2, 2.74, 2.76, 2.99, 3.01, 5.0, 20.0}) {
    for (const double b : {0.003, 0.1, 0.5, 1.1, 2.0, 2.74, 2.76, 2.99, 3.01, 6.0, 30.0}) {
      const Complex down = std::polar(1.0, -std::numbers::pi / 4);
      Complex sum = 0;
      const int steps = 200000;
      const double h = 8.0 / steps;
      for (int i = 0; i <= steps; ++i) {
        const double s = i * h;
        const Complex t = u + s * down;
        const double weight = i == 0 || i == steps ? 0.5 : 1;
        sum += weight * h * down * std::exp(-Complex(0, 1) * (t * t - u * u)) * b / (std::numbers::pi * (t * t + b * b));
      }
      const Lanes us = all_lanes(static_cast<float>(u)), bs = all_lanes(static_cast<float>(b));
      const Complex tail = lane(edge_tail(us, bs, scaled_erfc(bs), scaled_erfc(us), us[0]), 3);
      EXPECT_LT(std::abs(tail - sum), 2e-3 / (1 + u)) << u << " " << b << " " << tail << sum;
    }
  }
}

TEST(FiniteEdge, LanesDoNotSeeEachOther) {
  // Eight wavenumbers at once are each alone, to the bit: near and far terms meet in one group.
  const FiniteWedge wedge(edge_of(1.5 * std::numbers::pi, 1.3), cartesian({1.1, 0.4, 0.2}), cartesian({2.3, 4.0, 0.9}));
  std::array<double, kLanes> wavenumbers;
  for (std::size_t i = 0; i < kLanes; ++i) wavenumbers[i] = 1.15 * std::exp2(static_cast<double>(i));
  FaceFactorLanes faces{.first = all_lanes(1), .second = all_lanes(1), .incidence = all_lanes(1)};
  const ComplexLanes together = wedge.ratio(WaveLanes(wavenumbers), wedge.own_length_m(), faces);
  for (std::size_t i = 0; i < kLanes; ++i) EXPECT_EQ(lane(together, i), ratio(wedge, wavenumbers[i])) << i;
}

TEST(O24FiniteEdge, LineIntegralOfEdgesOfZeroPointTwoToFourMetres) {
  // Screens, corners and a blunt wedge; source and listener anywhere about the edge and up to half its length past its ends, as near as
  // 0.5 m.  Within 1 dB, or, in nulls between the ends' waves and behind blunt wedges, wrong by less than 1.5 % (36 dB) of the free field.
  int cases = 0, in_nulls = 0;
  for (const double exterior : {2 * std::numbers::pi, 1.5 * std::numbers::pi, 1.2 * std::numbers::pi}) {
    for (const double length_m : {0.2, 0.5, 1.0, 2.0, 4.0}) {
      for (std::uint32_t i = 0; i < 10; ++i) {
        const RandomStream random(5, Purpose::test, i);
        const auto point = [&](std::uint32_t draw) {
          return finite_wedge::Point{0.5 + 3 * random.uniform(draw), exterior * random.uniform(draw + 1),
                                     length_m * (2 * random.uniform(draw + 2) - 0.5)};
        };
        const finite_wedge::Point source = point(0), listener = point(3);
        const DiffractionEdge edge = edge_of(exterior, length_m);
        const double free = 1 / (4 * std::numbers::pi * std::hypot(source.r + listener.r, source.z - listener.z));
        for (const double frequency_hz : {63., 125., 250., 500., 1000., 2000., 4000.}) {
          const double k = 2 * std::numbers::pi * frequency_hz / 343;
          const Complex exact = finite_wedge::line_integral(exterior, source, listener, 0, length_m, k);
          const Complex ours = pressure(edge, source, listener, k);
          ++cases;
          if (std::abs(rooms::amplitude_db(std::abs(ours / exact))) < 1.0) continue;
          ++in_nulls;
          EXPECT_LT(std::abs(ours - exact), 0.015 * free) << exterior << " " << length_m << " " << i << " " << frequency_hz;
        }
      }
    }
  }
  EXPECT_LT(in_nulls, cases / 100);
}

TEST(O24FiniteEdge, ShortEdgesScatterByTheirLengthAndPiecesAddUp) {
  const finite_wedge::Point source{2, 0.3, 0.3}, listener{2.5, 0.6, -0.2};
  const double k = 2 * std::numbers::pi * 125 / 343;
  // Far from all boundaries an endless edge is as good as sqrt(2 pi / (k g)) of it, g = sin^2(beta) (1 / s + 1 / s'): stationary phase.
  // The transition functions leave 0.5 dB at 125 Hz.
  const auto about_apex = [&](double length_m) {
    DiffractionEdge edge = edge_of(2 * std::numbers::pi, length_m);
    edge.start = {0, 0, 0.08 - 0.5 * length_m};
    const FiniteWedge wedge(edge, cartesian(source), cartesian(listener));
    return std::abs(ratio(wedge, k));
  };
  const double around = source.r + listener.r, sine = around / std::hypot(around, source.z - listener.z);
  const double g = sine * sine * sine * (1 / source.r + 1 / listener.r);
  EXPECT_NEAR(rooms::amplitude_db(about_apex(0.2) / about_apex(0.1)), rooms::amplitude_db(2), 0.05);
  EXPECT_NEAR(rooms::amplitude_db(about_apex(0.25) / about_apex(1000)),
              rooms::amplitude_db(0.25 * std::sqrt(k * g / (2 * std::numbers::pi))), 0.5);
  // Three pieces of one edge: the sum of their waves, by their own ways, is that of the whole.
  Complex sum = 0;
  const std::array<double, 4> ends = {-1.3, -0.1, 0.9, 2.0};
  const auto wave = [&](double from_m, double to_m) {
    DiffractionEdge edge = edge_of(2 * std::numbers::pi, to_m - from_m);
    const finite_wedge::Point a{source.r, source.angle_rad, source.z - from_m}, b{listener.r, listener.angle_rad, listener.z - from_m};
    return pressure(edge, a, b, k);
  };
  for (std::size_t i = 0; i < 3; ++i) sum += wave(ends[i], ends[i + 1]);
  EXPECT_LT(std::abs(sum - wave(-1.3, 2.0)), 0.02 * std::abs(sum));
}

TEST(FiniteEdge, LongEdgesAreEndless) {
  for (const double exterior : {2 * std::numbers::pi, 1.5 * std::numbers::pi}) {
    DiffractionEdge edge = edge_of(exterior, 4000);
    edge.start = {0, 0, -2000};
    const FiniteWedge wedge(edge, cartesian({2, 0.7, 0}), cartesian({3, 4.2, 1}));
    for (const double k : {1.0, 10.0, 100.0}) {
      const Complex endless = uniform_theory::ratio(wedge.endless(), k * wedge.own_length_m());
      EXPECT_LT(std::abs(ratio(wedge, k) - endless), 1e-3 * std::abs(endless));
    }
  }
}

}  // namespace
}  // namespace earshot
