// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/scattered_energy.h"

#include <gtest/gtest.h>

#include <limits>

namespace earshot {
namespace {

Arrival scattered_at(float distance_m, float amplitude) {
  Arrival arrival;
  arrival.distance_m = distance_m;
  arrival.direction = arrival.departure = {0, 0, -1};
  arrival.amplitude.fill(amplitude);
  return arrival;
}

TEST(ScatteredEnergy, JoinsTheLateFieldWithoutADirection) {
  EnergyHistogram late(25, 3, 1, 0.004f);
  add_scattered_energy(std::vector{scattered_at(3.43f, 0.5f), scattered_at(6.86f, 0.25f)}, 343.f, late);
  for (int band = 0; band < 3; ++band) {
    double sum = 0;
    for (int bin = 0; bin < 25; ++bin) sum += static_cast<double>(late.energy(bin, band));
    EXPECT_NEAR(sum, 0.3125, 1e-6);
  }
  EXPECT_GT(late.energy(2, 0), 0.f);  // 10 ms
  for (std::size_t i = 0; i < late.values().size(); ++i) EXPECT_TRUE(i % 4 == 0 || late.values()[i] == 0.f) << i;
}

// The policy for arrivals holds for what panels scatter.
TEST(ScatteredEnergy, WhatIsNotFiniteIsDroppedAndCounted) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  std::vector<Arrival> scattered = {scattered_at(3, 0.5f), scattered_at(nan, 0.5f), scattered_at(3, infinity), scattered_at(4, nan)};
  scattered[0].amplitude[5] = nan;  // of a band that does not exist
  EXPECT_EQ(drop_nonfinite(3, scattered), 3u);
  ASSERT_EQ(scattered.size(), 1u);
  EXPECT_EQ(scattered[0].distance_m, 3.f);
}

}  // namespace
}  // namespace earshot
