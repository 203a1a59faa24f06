// SPDX-License-Identifier: Apache-2.0
#include "sim/scene/materials/wall_impedance.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "sim/scene/materials/materials.h"

namespace earshot {
namespace {

using Complex = std::complex<double>;
using testing::HasSubstr;

/// Paris' integral by midpoints over the cosine: twice the integral of (1 - |R|^2) cos d(cos).
double integrated(Complex impedance) {
  constexpr int parts = 200'000;
  double sum = 0;
  for (int i = 0; i < parts; ++i) {
    const double cosine = (i + 0.5) / parts;
    sum += 2.0 * (1.0 - std::norm((impedance * cosine - 1.0) / (impedance * cosine + 1.0))) * cosine / parts;
  }
  return sum;
}

Complex drawn_impedance(std::uint32_t number) {
  const RandomStream random(7, Purpose::test, number);
  const auto within = [&](std::uint32_t draw, double low, double high) {
    return low + (high - low) * static_cast<double>(random.uniform(draw));
  };
  const double size = std::pow(10.0, within(0, -1.5, 2.5)), angle = within(1, -1.5, 1.5);
  return number % 4 == 0 ? Complex(size) : std::polar(size, angle);
}

TEST(WallImpedance, AbsorptionAtRandomIncidenceIsParisIntegral) {
  for (std::uint32_t number = 0; number < 24; ++number) {
    const Complex impedance = drawn_impedance(number);
    EXPECT_NEAR(random_incidence_absorption(impedance), integrated(impedance), 1e-6) << impedance;
  }
}

TEST(WallImpedance, TheImpedanceOfAnAbsorptionHasIt) {
  for (std::uint32_t number = 0; number < 12; ++number) {
    const double absorption = 0.95 * static_cast<double>(RandomStream(8, Purpose::test, number).uniform(0));
    const double impedance = impedance_of_absorption(absorption);
    EXPECT_GE(impedance, 1.56);
    EXPECT_NEAR(integrated(impedance), absorption, 2e-6) << absorption;
  }
  EXPECT_NEAR(random_incidence_absorption(impedance_of_absorption(1.0)), kLargestLocalAbsorption, 1e-6);
  for (int i = 0; i < 1000; ++i) EXPECT_LE(random_incidence_absorption(1.0 + 1e-3 * i), kLargestLocalAbsorption + 1e-9);
  EXPECT_EQ(impedance_of_absorption(0.0), 1e6);
}

Material read_one(const std::string& keys) {
  return MaterialDatabase::from_json(fmt::format(R"({{"materials": [{{"name": "wall", "scattering": [500, 0.1], {}}}]}})", keys),
                                     "walls.json")
      .get("wall", "");
}

TEST(WallImpedance, AMaterialWithAnImpedanceHasItsAbsorption) {
  for (std::uint32_t number = 0; number < 10; ++number) {
    const Complex impedance = drawn_impedance(100 + number);
    const Material wall =
        read_one(fmt::format(R"("impedance": [125, {0}, {1}, 1000, {2}, {1}])", impedance.real(), impedance.imag(), 3 * impedance.real()));
    EXPECT_TRUE(wall.locally_reacting);
    EXPECT_NEAR(wall.absorption.at(125), integrated(impedance), 1e-4);
    EXPECT_NEAR(wall.impedance_real.at(1000), 3 * impedance.real(), 1e-4 * std::abs(impedance));
    EXPECT_NEAR(wall.impedance_imaginary.at(500), impedance.imag(), 1e-4 * std::abs(impedance));
  }
  EXPECT_TRUE(read_one(R"("absorption": [125, 0.2], "angle": "locally_reacting")").locally_reacting);
  EXPECT_FALSE(read_one(R"("absorption": [125, 0.2], "angle": "random")").locally_reacting);
  EXPECT_FALSE(read_one(R"("absorption": [125, 0.2])").locally_reacting);
}

TEST(WallImpedance, WhatContradictsItselfIsRefused) {
  const auto refusal = [](const std::string& keys) -> std::string {
    try {
      read_one(keys);
    } catch (const InputError& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_THAT(refusal(R"("impedance": [125, 2, 0], "absorption": [125, 0.2])"), HasSubstr("'absorption'"));
  EXPECT_THAT(refusal(R"("impedance": [125, 2, 0], "angle": "random")"), HasSubstr("'angle'"));
  EXPECT_THAT(refusal(R"("impedance": [125, 2])"), HasSubstr("triples"));
  EXPECT_THAT(refusal(R"("impedance": [125, -2, 1])"), HasSubstr("not possible"));
  EXPECT_THAT(refusal(R"("impedance": [0, 2, 1])"), HasSubstr("not positive"));
  EXPECT_THAT(refusal(R"("impedance": [125, "2", 1])"), HasSubstr("not a number"));
  EXPECT_THAT(refusal(R"("absorption": [125, 0.2], "angle": "grazing")"), HasSubstr("locally_reacting"));
  EXPECT_THAT(refusal(R"("absorption": [125, 0.2], "transmission": [125, 0.1], "angle": "locally_reacting")"), HasSubstr("transmits"));
}

}  // namespace
}  // namespace earshot
