// SPDX-License-Identifier: Apache-2.0
// Concave surfaces of many facets: the focal gain of a dome and of a concave wall, against the mirror equation.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "sim/acoustics/paths/early_reflections.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using rooms::point;

constexpr double kHalfTurn = std::numbers::pi;

/// What curves: in both directions, or in one.
enum class Shape { dome, wall };

/// A mirror about the origin's vertical axis or plane, below the point (0, 0, radius_m), which is the middle of its curvature: a cap of a
/// sphere, or a part of a cylinder along y, of facets about facet_m wide.
std::shared_ptr<const Scene> curved_mirror(Shape shape, double radius_m, double half_rad, double facet_m) {
  const int steps = std::max(4, static_cast<int>(2 * half_rad * radius_m / facet_m));
  TriangleMesh mesh;
  // Turned a little, so that no facet or edge lies on the axis.
  const double aside = 0.37 * 2 * half_rad / steps;
  const auto at = [&](int i, int j) {
    const double a = -half_rad + 2 * half_rad * i / steps + aside;
    if (shape == Shape::wall) return point(radius_m * std::sin(a), (j - 0.5 * steps) * 10.0 / steps, radius_m * (1 - std::cos(a)));
    const double b = -half_rad + 2 * half_rad * j / steps + 0.61 * aside;
    const glm::dvec3 way = glm::normalize(glm::dvec3(std::tan(a), std::tan(b), -1));
    return point(radius_m * way.x, radius_m * way.y, radius_m * (1 + way.z));
  };
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < (shape == Shape::wall ? 1 : steps); ++j) {
      const std::array corners{at(i, shape == Shape::wall ? 0 : j), at(i + 1, shape == Shape::wall ? 0 : j),
                               at(i + 1, shape == Shape::wall ? steps : j + 1), at(i, shape == Shape::wall ? steps : j + 1)};
      rooms::append_quad(mesh, corners, 0);
    }
  return rooms::scene_of(std::move(mesh), {Material::uniform("rigid", 0.f, 0.f)});
}

/// Energy of the image at distance l from the vertex of a source at s, over that of a plane mirror there: in each direction in which it
/// curves the wave has the radius s + l - 2 s l / radius instead of s + l.
double focal_gain(Shape shape, double radius_m, double s, double l) {
  const double gain = (s + l) / std::abs(s + l - 2 * s * l / radius_m);
  return shape == Shape::dome ? gain * gain : gain;
}

struct Found {
  double energy = 0, coherent = 0;  ///< over those of a plane mirror
  int images = 0;
};

Found found_gain(Shape shape, double radius_m, double s, double l, double facet_m) {
  AcousticConfig config;
  config.early_order = 1;
  config.early_candidate_rays = 200'000;
  config.diffraction = config.air_absorption = config.late = Switch::off;
  config.bands = 1;
  const AcousticScene scene(curved_mirror(shape, radius_m, 0.35, facet_m), config);
  std::vector<Arrival> arrivals;
  EarlyCandidates(scene, point(0, 0, s)).find_arrivals(scene, point(0, 0, l), arrivals);
  Found found;
  std::complex<double> pressure = 0;
  const double k = 2 * kHalfTurn * 500 / rooms::kSpeedMPerS;
  for (const Arrival& arrival : arrivals) {
    if (arrival.kind != ArrivalKind::reflection) continue;
    ++found.images;
    found.energy += double{arrival.amplitude[0]} * double{arrival.amplitude[0]};
    pressure += std::polar(double{arrival.amplitude[0]}, -k * arrival.distance_m);
  }
  const double plane = 1 / (4 * kHalfTurn * (s + l));
  found.energy /= plane * plane;
  found.coherent = std::norm(pressure) / (plane * plane);
  return found;
}

struct FocalCase {
  double radius_m, s, l, facet_m;
};

FocalCase drawn_case(Shape shape, std::uint32_t number) {
  const RandomStream random(40, Purpose::test, number);
  const auto within = [&](std::uint32_t draw, double low, double high) {
    return low + (high - low) * static_cast<double>(random.uniform(draw));
  };
  for (std::uint32_t draw = 0;; draw += 4) {
    const double radius_m = within(draw, 6, 15), s = radius_m * within(draw + 1, 0.3, 0.9), l = radius_m * within(draw + 2, 0.3, 0.9);
    const double gain = focal_gain(shape, radius_m, s, l);
    if (gain > 4 && gain < (shape == Shape::dome ? 80 : 20)) return {radius_m, s, l, 0.25};
  }
}

void expect_focal_gain(Shape shape, double tolerance_db) {
  double mean_db = 0;
  for (std::uint32_t number = 0; number < 10; ++number) {
    const FocalCase drawn = drawn_case(shape, number + (shape == Shape::dome ? 0 : 100));
    const double expected = focal_gain(shape, drawn.radius_m, drawn.s, drawn.l);
    const Found found = found_gain(shape, drawn.radius_m, drawn.s, drawn.l, drawn.facet_m);
    const double error_db = 10 * std::log10(found.energy / expected);
    EXPECT_NEAR(error_db, 0, tolerance_db) << number << ": gain " << expected << ", images " << found.images << ", coherent "
                                           << 10 * std::log10(found.coherent / expected) << " dB";
    mean_db += error_db / 10;
    // Images of facets arrive together, so their pressures add up to more than a curved mirror gives: by up to the gain once more.
    const double coherent_db = 10 * std::log10(found.coherent / expected);
    EXPECT_GT(coherent_db, -tolerance_db) << number;
    EXPECT_LT(coherent_db, 10 * std::log10(expected) + 2 * tolerance_db) << number;
  }
  EXPECT_NEAR(mean_db, 0, 0.5 * tolerance_db);
}

TEST(CurvedMirror, ADomeFocusesEnergyByTheMirrorEquation) { expect_focal_gain(Shape::dome, 1.5); }
TEST(CurvedMirror, AConcaveWallFocusesEnergyByTheMirrorEquation) { expect_focal_gain(Shape::wall, 1.5); }

}  // namespace
}  // namespace earshot
