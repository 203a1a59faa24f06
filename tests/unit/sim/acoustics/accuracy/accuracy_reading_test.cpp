// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/accuracy/accuracy_reading.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr int kPlaces = 200, kBands = 8;

/// Gaussian, by Box and Muller.
double normal(std::uint32_t a, std::uint32_t b, std::uint32_t stream) {
  const auto words = RandomStream(7, Purpose::test, a, b, stream).bits4(0);
  return std::sqrt(-2 * std::log((words[0] + 0.5) / 4294967296.0)) * std::cos(2 * std::numbers::pi * words[1] / 4294967296.0);
}

/// A decay time of 1 s, a ratio of -6 dB, a curve that falls by 60 dB a second; each off by a bias and by noise of its own.
std::vector<AccuracyReading> readings(double bias, double noise, std::uint32_t stream) {
  std::vector<AccuracyReading> all(kPlaces);
  for (std::uint32_t place = 0; place < kPlaces; ++place)
    for (std::uint32_t band = 0; band < kBands; ++band) {
      const auto off = [&](std::uint32_t what) { return bias + noise * normal(place, band, 4 * stream + what); };
      all[place].t20_s.emplace_back(1 + off(0));
      all[place].drr_db.emplace_back(-6 + 10 * off(1));
      std::vector<float>& curve = all[place].edc_db.emplace_back();
      const double rise_db = 10 * off(2);
      for (int i = 0; i < 250; ++i) curve.push_back(static_cast<float>(i == 0 ? 0 : -60 * 0.004 * i + rise_db));
    }
  return all;
}

TEST(AccuracyReading, ErrorsAreThoseToTheTruthWhateverItsNoise) {
  // Standard error of the root of the mean product over 1,600 values: bias 0.1 and noise 0.1 on each side, below 3 %.
  for (const double noise : {0.0, 0.05, 0.1}) {
    const auto first = readings(0, noise, 1), second = readings(0, noise, 2);
    const AccuracyErrors biased = errors_between(readings(0.1, 0, 3), first, second);
    EXPECT_NEAR(biased[0], 0.1, 0.008 + noise * noise) << noise;  // relative to a noisy truth: the mean of 1 / (1 + noise)
    EXPECT_NEAR(biased[1], 1.0, 0.08) << noise;
    EXPECT_NEAR(biased[2], 1.0, 0.1) << noise;
    const AccuracyErrors random = errors_between(readings(0, 0.2, 4), first, second);
    EXPECT_NEAR(random[0], 0.2, 0.016) << noise;
    EXPECT_NEAR(random[1], 2, 0.16) << noise;
    EXPECT_NEAR(random[2], 2, 0.2) << noise;
  }
}

TEST(AccuracyReading, StandardErrorsOfTheMeanSquareComeFromTheSpreadOverPlaces) {
  // Half of the places err by 0.1, the others not at all: the mean square is 0.005, its standard error 0.005 / sqrt(199).
  const auto truth = readings(0, 0, 1);
  auto test = truth;
  for (std::size_t place = 0; place < kPlaces; place += 2)
    for (auto& value : test[place].t20_s) *value += 0.1;
  EXPECT_NEAR(errors_between(test, truth, truth)[0], std::sqrt(0.005), 1e-5);
  EXPECT_NEAR(errors_between(test, truth, truth, 2)[0], std::sqrt(0.005 + 2 * 0.005 / std::sqrt(199)), 1e-5);
}

TEST(AccuracyReading, HalvesTellTheErrorOfTheirMean) {
  const AccuracyErrors error = half_difference(readings(0, 0.1, 1), readings(0, 0.1, 2));
  EXPECT_NEAR(error[0], 0.1 / std::numbers::sqrt2, 0.005);
  EXPECT_NEAR(error[1], 1 / std::numbers::sqrt2, 0.05);
  EXPECT_NEAR(error[2], 1 / std::numbers::sqrt2, 0.05);
}

TEST(AccuracyReading, WhatTheTestLacksIsAnErrorAndWhatTheTruthLacksIsNone) {
  auto truth = readings(0, 0, 1), test = truth;
  for (auto& place : test) place.t20_s[0].reset();
  EXPECT_NEAR(errors_between(test, truth, truth)[0], std::sqrt(1.0 / kBands), 1e-6);
  for (auto& place : truth)
    for (auto& value : place.t20_s) value.reset();
  EXPECT_TRUE(std::isnan(errors_between(test, truth, truth)[0]));
}

}  // namespace
}  // namespace earshot
