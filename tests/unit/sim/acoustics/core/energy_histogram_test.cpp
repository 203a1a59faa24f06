// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/energy_histogram.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

namespace earshot {
namespace {

constexpr std::array<float, 1> kOmni = {1.f};

double sum_of(const EnergyHistogram& h) {
  double sum = 0;
  for (const double e : h.band_energy(0)) sum += e;
  return sum;
}

TEST(EnergyHistogram, SplitKeepsEnergyAndMeanTime) {
  for (const double time_s : {0.0021, 0.004, 0.0059, 0.00999, 0.0341}) {
    EnergyHistogram h(10, 1, 0, 0.004f);
    h.add(static_cast<float>(time_s), std::array{2.f}, kOmni);
    double moment = 0;
    for (int i = 0; i < 10; ++i) moment += h.energy(i, 0) * (i + 0.5) * 0.004;
    EXPECT_NEAR(sum_of(h), 2.0, 1e-6);
    EXPECT_NEAR(moment / 2.0, time_s, 1e-8);  // float division of the time by the bin
    EXPECT_EQ(h.dropped_energy(), 0);
  }
}

TEST(EnergyHistogram, EndsNeverWrapH41) {
  EnergyHistogram h(10, 1, 0, 0.25f);  // exact in binary: the last edge is 2.5 s
  h.add(2.5f, std::array{1.f}, kOmni);
  EXPECT_EQ(h.energy(9, 0), 1.f);
  h.add(std::nextafter(2.5f, 3.f), std::array{1.f}, kOmni);
  h.add(1e30f, std::array{1.f}, kOmni);
  h.add(std::numeric_limits<float>::infinity(), std::array{1.f}, kOmni);
  h.add(-0.1f, std::array{1.f}, kOmni);
  EXPECT_EQ(sum_of(h), 1.0);
  EXPECT_EQ(h.dropped_energy(), 4.0);
  h.add(0.f, std::array{1.f}, kOmni);
  EXPECT_EQ(h.energy(0, 0), 1.f);
}

TEST(EnergyHistogram, BoundaryPlusMinusOneUlpH42) {
  for (const float time_s : {std::nextafter(0.5f, 0.f), 0.5f, std::nextafter(0.5f, 1.f)}) {
    EnergyHistogram h(10, 1, 0, 0.25f);
    h.add(time_s, std::array{1.f}, kOmni);
    EXPECT_NEAR(h.energy(1, 0), 0.5f, 1e-6f);
    EXPECT_NEAR(h.energy(2, 0), 0.5f, 1e-6f);
  }
}

TEST(EnergyHistogram, BandsAndHarmonicsHaveTheirOwnCells) {
  EnergyHistogram h(4, 3, 1, 1.f);
  ASSERT_EQ(h.num_coefficients(), 4);
  h.add(1.5f, std::array{1.f, 2.f, 4.f}, std::array{1.f, 0.5f, -0.25f, 0.f});
  for (int band = 0; band < 3; ++band) {
    const float energy = static_cast<float>(1 << band);
    EXPECT_EQ(h.energy(1, band), energy);
    EXPECT_EQ(h.at(1, band)[1], 0.5f * energy);
    EXPECT_EQ(h.at(1, band)[2], -0.25f * energy);
    EXPECT_EQ(h.energy(0, band), 0.f);
    EXPECT_EQ(h.energy(2, band), 0.f);
  }
}

TEST(EnergyHistogram, AttenuatesByPathLength) {
  EnergyHistogram h(1000, 2, 0, 0.004f);
  for (int i = 0; i < 1000; ++i) h.add((static_cast<float>(i) + 0.5f) * 0.004f, std::array{1.f, 1.f}, kOmni);
  EnergyHistogram before = h;
  h.attenuate(std::array{0.f, 0.001f}, 343.f);
  for (const int i : {0, 1, 500, 999}) {
    EXPECT_EQ(h.energy(i, 0), before.energy(i, 0));
    const double expected = std::exp(-0.001 * 343.0 * (i + 0.5) * 0.004);
    EXPECT_NEAR(h.energy(i, 1) / before.energy(i, 1), expected, 1e-6);
  }
}

TEST(EnergyHistogram, AddsAndScales) {
  EnergyHistogram a(2, 1, 0, 1.f), b = a;
  a.add(0.5f, std::array{1.f}, kOmni);
  b.add(1.5f, std::array{3.f}, kOmni);
  b.add(9.f, std::array{5.f}, kOmni);
  a.add(b);
  a.scale(0.5f);
  EXPECT_EQ(a.energy(0, 0), 0.5f);
  EXPECT_EQ(a.energy(1, 0), 1.5f);
  EXPECT_EQ(a.dropped_energy(), 2.5);
  a.clear();
  EXPECT_EQ(sum_of(a), 0.0);
  EXPECT_EQ(a.dropped_energy(), 0.0);
  EXPECT_EQ(a.num_bins(), 2);
}

}  // namespace
}  // namespace earshot
