// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include "sim/acoustics/paths/early_reflections.h"
#include "sim/acoustics/tracers/bidirectional_tracer.h"
#include "sim/base/random.h"
#include "sim/scene/materials/wall_impedance.h"
#include "tests/support/acoustics/rooms.h"

namespace earshot {
namespace {

using rooms::point;

/// A floor that reacts locally under a ceiling that absorbs all: every chain of mirrors is the one reflection.
struct Floor {
  double height_m, ceiling_m;  ///< of the listener, of the ceiling
  std::complex<double> impedance;

  [[nodiscard]] std::shared_ptr<const Scene> scene() const {
    Material floor = Material::uniform("floor", static_cast<float>(random_incidence_absorption(impedance)), 0.f);
    floor.locally_reacting = true;
    floor.impedance_real = CoefficientCurve::constant(static_cast<float>(impedance.real()));
    floor.impedance_imaginary = CoefficientCurve::constant(static_cast<float>(impedance.imag()));
    TriangleMesh mesh;
    const double half_m = 300;
    for (const int slot : {0, 1}) {
      const double z = slot == 0 ? 0.0 : ceiling_m;
      rooms::append_quad(mesh, {point(-half_m, -half_m, z), point(half_m, -half_m, z), point(half_m, half_m, z), point(-half_m, half_m, z)},
                         static_cast<std::uint32_t>(slot));
    }
    return rooms::scene_of(std::move(mesh), {floor, Material::uniform("ceiling", 1.f, 0.f)});
  }
  /// Of two images at the middle of the segment behind the floor, path_m from the listener, within one bin of bin_m
  /// (bidirectional_tracer.h): they come once in twice the way to the floor.
  [[nodiscard]] double unseen(double path_m, double bin_m) const {
    const double cosine = (height_m + 0.5 * ceiling_m) / path_m, to_floor_m = height_m / cosine;
    const double pressure = std::abs((impedance * cosine - 1.0) / (impedance * cosine + 1.0));
    return std::min(bin_m / (2 * to_floor_m), 1.0) * 2 * std::pow(pressure / (4 * std::numbers::pi * path_m), 2);
  }
};

// What a chain of mirrors may hold that no ray was caught in is at most two images, each reflected by the angle of the ray; every bin has
// the angles of its path lengths.  Tolerance: single precision and the least and largest value within the bin.  At random incidence walls
// would be off by a factor of 1.3 and more in most bins.
TEST(UnseenChains, ReflectByTheAngle) {
  int bins = 0, told_apart = 0;
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RandomStream random(561, Purpose::test, number);
    const auto draw = [&](std::uint32_t i, double low, double high) { return low + (high - low) * double{random.uniform(i)}; };
    const Floor floor{draw(0, 0.5, 2), draw(1, 2.5, 4), std::polar(std::pow(10.0, draw(2, -0.2, 1.2)), draw(3, -1.2, 1.2))};
    AcousticConfig config;
    config.bands = 1;
    config.early = config.diffraction = config.air_absorption = Switch::off;
    config.late = Switch::on;
    config.rays = 4096;
    config.source_rays = 16;
    config.source_radius_m = 1e-3f;  // a ray is hardly caught: two images are less than what its chance would leave
    config.time_bin_s = 0.001f;
    config.rir_length_s = 0.05f;
    const AcousticScene scene(floor.scene(), config);
    const EarlyCandidates candidates(scene, point(2, 1, floor.height_m));
    EnergyHistogram histogram = make_histogram(scene);
    LateBatches batches;
    trace_bidirectional(scene, candidates, point(0, 0, floor.height_m), histogram, &batches);
    const double bin_m = double{histogram.bin_s()} * double{scene.speed_of_sound_m_per_s()};
    for (int bin = 0; bin < batches.num_bins; ++bin) {
      const double found = batches.unseen[static_cast<std::size_t>(bin)];
      if (!(found > 0)) continue;
      double least = std::numeric_limits<double>::infinity(), largest = 0, at_random = 0;
      for (int i = 0; i <= 200; ++i) {
        const double path_m = std::max((bin + i / 200.0) * bin_m, floor.height_m + 0.5 * floor.ceiling_m);
        const double expected = floor.unseen(path_m, bin_m);
        least = std::min(least, expected), largest = std::max(largest, expected);
        const double cosine = (floor.height_m + 0.5 * floor.ceiling_m) / path_m;
        at_random = std::max(at_random, expected * (1 - random_incidence_absorption(floor.impedance)) /
                                            std::norm((floor.impedance * cosine - 1.0) / (floor.impedance * cosine + 1.0)));
      }
      EXPECT_GE(found, 0.999 * least) << number << ", bin " << bin;
      EXPECT_LE(found, 1.001 * largest) << number << ", bin " << bin;
      ++bins;
      told_apart += at_random < 0.8 * least || at_random > 1.25 * largest;
    }
  }
  EXPECT_GT(bins, 200);
  EXPECT_GT(told_apart, bins / 2);
}

}  // namespace
}  // namespace earshot
