// SPDX-License-Identifier: Apache-2.0
#include "tests/support/acoustics/radiosity.h"

#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/acoustics/decay.h"

// The radiosity solver is judged first, by closed forms and by docs/evidence/oracles.md, O-10, before it judges the tracer
// (radiosity_slow_test.cpp).
namespace earshot {
namespace {

using radiosity::Box;
using radiosity::extrapolate;
using radiosity::Solver;

constexpr radiosity::Point kSource{1.2, 1.5, 1.1}, kListener{3.8, 2.3, 1.6};

Box shoe1(double absorption, double floor) { return {{5, 4, 3}, {absorption, absorption, absorption, absorption, floor, absorption}}; }

TEST(Radiosity, FormFactorsOfAUnitCube) {
  // Howell C-11 and C-14: opposite faces 0.199825, adjacent faces 0.200044; the five add up to 1.
  const Solver cube({{1, 1, 1}, {}}, 1);
  EXPECT_EQ(cube.size(), 6u);
  const auto faces = radiosity::make_patches({{1, 1, 1}, {}}, 1);
  EXPECT_NEAR(radiosity::form_factor(faces[0], faces[1]), 0.199825, 1e-6);
  EXPECT_NEAR(radiosity::form_factor(faces[0], faces[2]), 0.200044, 1e-6);
  EXPECT_LT(cube.row_error(), 1e-12);
}

TEST(Radiosity, EveryRowOfFormFactorsAddsUpToOne) {
  EXPECT_LT(Solver({{5.3, 4.1, 2.7}, {}}, 2).row_error(), 1e-11);  // rounding of the antiderivatives grows with the number of patches
}

TEST(Radiosity, SolidAnglesCoverTheSphere) {
  double sum = 0;
  for (const auto& patch : radiosity::make_patches(shoe1(0.1, 0.1), 1)) sum += radiosity::solid_angle(patch, kSource);
  EXPECT_NEAR(sum, 4 * std::numbers::pi, 1e-12);
}

TEST(OracleO10, RadiositySolverHitsTheExactLambertBoxes) {
  struct Case {
    double absorption, floor, energy, t60_s;
  };
  // T60 of "floor.6" from the table of O-14.
  for (const Case& c :
       {Case{.1, .1, 0.028595, 0.99755}, {.2, .2, 0.012029, 0.48135}, {.5, .5, 0.0026387, 0.1661}, {.05, .6, 0.013665, 0.5406}}) {
    const Solver coarse(shoe1(c.absorption, c.floor), 1), fine(shoe1(c.absorption, c.floor), 2);
    // Patches of 1 and 0.5 m, extrapolated: 0.05 % in energy, 0.15 % in time (the last terms that h^2 leaves).
    EXPECT_NEAR(extrapolate(coarse.steady_energy(kSource, kListener), 1, fine.steady_energy(kSource, kListener), 2), c.energy,
                7e-4 * c.energy);
    EXPECT_NEAR(extrapolate(coarse.slowest_decay_s(), 1, fine.slowest_decay_s(), 2), c.t60_s, 2e-3 * c.t60_s);
  }
}

TEST(OracleO17, RadiositySolverIsReciprocal) {
  const Solver solver(shoe1(0.05, 0.6), 1);
  const double forward = solver.steady_energy(kSource, kListener), backward = solver.steady_energy(kListener, kSource);
  EXPECT_NEAR(forward, backward, 1e-10 * forward);  // exact for any patches; the iteration stops at 1e-13 of change
}

TEST(OracleO10, TimeSeriesOfTheRadiositySolverHasTheLaplaceSums) {
  const double bin_s = 5e-4, sigma[] = {0, 5, 10, 20, 40}, sums[] = {0.012029, 0.0096258, 0.0078759, 0.0055258, 0.0030544};
  double value[2][5];
  for (int k = 0; k < 2; ++k) {
    const auto series = Solver(shoe1(0.2, 0.2), k + 1).energy_series(kSource, kListener, bin_s, 0.6);
    for (int i = 0; i < 5; ++i) {
      value[k][i] = 0;
      for (std::size_t t = 0; t < series.size(); ++t) value[k][i] += series[t] * std::exp(-sigma[i] * static_cast<double>(t) * bin_s);
    }
  }
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(extrapolate(value[0][i], 1, value[1][i], 2), sums[i], 2e-3 * sums[i]) << sigma[i];
}

}  // namespace
}  // namespace earshot
