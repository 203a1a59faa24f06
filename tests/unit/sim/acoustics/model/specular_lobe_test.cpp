// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/model/specular_lobe.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr float kExponents[] = {1, 5, 10, 30, 100, 1000};

glm::vec3 at_angle(double degrees) {
  const double angle = degrees * kPi / 180;
  return {static_cast<float>(std::sin(angle)), 0.f, static_cast<float>(std::cos(angle))};
}

const glm::vec3 kUp(0, 0, 1);

/// Integral over the hemisphere above kUp of f(direction), by the midpoint rule in coordinates about the mirror direction of `in`, where
/// the lobe is smooth: gamma in steps that shrink with the lobe, then the azimuth.
double integrate(glm::vec3 in, float exponent, const std::function<double(glm::vec3)>& f, int gammas = 1000, int azimuths = 480) {
  const glm::dvec3 mirror(-in.x, -in.y, in.z), y(0, 1, 0), x(glm::cross(y, mirror));
  double sum = 0;
  const double scale = std::sqrt(exponent);  // gamma = atan-like spacing: half of the steps within two lobe widths
  const double last = std::asinh(scale * kPi);
  for (int i = 0; i < gammas; ++i) {
    const double step = last / gammas, at = (i + 0.5) * step, gamma = std::sinh(at) / scale, width = std::cosh(at) / scale * step;
    for (int k = 0; k < azimuths; ++k) {
      const double azimuth = 2 * kPi * (k + 0.5) / azimuths;
      const glm::dvec3 d = std::cos(gamma) * mirror + std::sin(gamma) * (std::cos(azimuth) * x + std::sin(azimuth) * y);
      if (d.z > 0) sum += f(glm::vec3(d)) * std::sin(gamma) * width * 2 * kPi / azimuths;
    }
  }
  return sum;
}

TEST(OracleO30, AlbedoOfTheMaxNormalisedPhongLobe) {
  // Table of docs/evidence/oracles.md, O-30: 0, 30, 60, 75, 85 degrees, hemispherical mean.  Four digits are given.
  const double expected[6][6] = {{1.0000, 0.9914, 0.8899, 0.8210, 0.7738, 0.9343}, {1.0000, 0.9676, 0.8225, 0.7111, 0.6268, 0.8854},
                                 {1.0000, 0.9673, 0.8395, 0.7130, 0.6038, 0.8915}, {1.0000, 0.9729, 0.8907, 0.7687, 0.6120, 0.9175},
                                 {1.0000, 0.9817, 0.9359, 0.8569, 0.6701, 0.9472}, {1.0000, 0.9932, 0.9787, 0.9534, 0.8566, 0.9812}};
  const double degrees[] = {0, 30, 60, 75, 85};
  for (int n = 0; n < 6; ++n) {
    const SpecularLobe lobe(kExponents[n]);
    for (int i = 0; i < 5; ++i) {
      EXPECT_NEAR(lobe.phong_albedo(static_cast<float>(std::cos(degrees[i] * kPi / 180))), expected[n][i], 1e-4)
          << kExponents[n] << " " << i;
    }
    EXPECT_NEAR(lobe.mean_phong_albedo(), expected[n][5], 1e-4) << kExponents[n];
  }
}

TEST(OracleO30, NothingIsLost) {
  for (const float exponent : kExponents) {
    const SpecularLobe lobe(exponent);
    for (const double degrees : {0.0, 10.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 85.0, 87.0, 89.0}) {
      const glm::vec3 in = at_angle(degrees);
      const double albedo = integrate(in, exponent, [&](glm::vec3 out) { return double{lobe.value(kUp, in, out)} * out.z; });
      // The required 1e-4; without the compensation 0.6 to 0.9 of the energy would be left at 85 degrees.
      EXPECT_NEAR(albedo, 1.0, 1e-4) << "n = " << exponent << ", " << degrees << " degrees";
    }
  }
}

TEST(OracleO30, TheDensityIntegratesToOne) {
  for (const float exponent : kExponents) {
    const SpecularLobe lobe(exponent);
    for (const double degrees : {0.0, 30.0, 60.0, 85.0}) {
      const glm::vec3 in = at_angle(degrees);
      const double sum = integrate(in, exponent, [&](glm::vec3 out) { return double{lobe.pdf(kUp, in, out)}; });
      // Half of the folded lobe lies where the grid is coarse, and the density of the compensation has steps.
      EXPECT_NEAR(sum, 1.0, 1e-3) << "n = " << exponent << ", " << degrees << " degrees";
    }
  }
}

TEST(OracleO30, ReciprocalInEveryPairOfDirections) {
  const RandomStream random(3, Purpose::test);
  for (const float exponent : kExponents) {
    const SpecularLobe lobe(exponent);
    for (std::uint32_t i = 0; i < 200; ++i) {
      const auto u = random.uniform4(i);
      const auto direction = [](float height, float turn) {
        const float radius = std::sqrt(1 - height * height), angle = 2 * static_cast<float>(kPi) * turn;
        return glm::vec3(radius * std::cos(angle), radius * std::sin(angle), height);
      };
      const glm::vec3 a = direction(u[0], u[1]), b = direction(u[2], u[3]);
      // The order of the products differs by roundings, which the exponent multiplies.
      EXPECT_NEAR(lobe.value(kUp, a, b), lobe.value(kUp, b, a), 1e-6f * exponent * (1 + lobe.value(kUp, a, b)));
    }
  }
}

/// Upper tail of chi-square by Wilson and Hilferty 1931.
double chi_square_p(double value, int freedom) {
  const double k = freedom, z = (std::cbrt(value / k) - (1 - 2 / (9 * k))) / std::sqrt(2 / (9 * k));
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

TEST(OracleO30, SamplesFollowTheDensity) {
  constexpr int heights = 8, turns = 8, samples = 200'000, fine = 64;  // 64 cells of equal solid angle
  for (const float exponent : {1.f, 10.f, 100.f}) {
    const SpecularLobe lobe(exponent);
    for (const double degrees : {0.0, 45.0, 80.0}) {
      const glm::vec3 in = at_angle(degrees);
      std::array<double, heights * turns> counted{}, expected{};
      const RandomStream random(5, Purpose::test, static_cast<std::uint32_t>(exponent), static_cast<std::uint32_t>(degrees));
      for (std::uint32_t i = 0; i < samples; ++i) {
        const auto u = random.uniform4(i);
        const glm::vec3 out = lobe.sample(kUp, in, u[0], u[1], u[2]);
        ASSERT_GE(out.z, 0.f);
        const int h = std::min(static_cast<int>(out.z * heights), heights - 1);
        const int t = std::min(static_cast<int>((std::atan2(out.y, out.x) / (2 * kPi) + 0.5) * turns), turns - 1);
        ++counted[h * turns + t];
      }
      for (int h = 0; h < heights * fine; ++h) {
        const double z = (h + 0.5) / (heights * fine), radius = std::sqrt(1 - z * z);
        for (int t = 0; t < turns * fine; ++t) {
          const double angle = 2 * kPi * ((t + 0.5) / (turns * fine) - 0.5);
          const glm::vec3 out(radius * std::cos(angle), radius * std::sin(angle), z);
          expected[h / fine * turns + t / fine] +=
              double{lobe.pdf(kUp, in, out)} * 2 * kPi / (double{heights} * turns * fine * fine) * samples;
        }
      }
      double chi_square = 0, rest_counted = 0, rest_expected = 0;
      int cells = 0;
      for (std::size_t i = 0; i < counted.size(); ++i) {
        if (expected[i] < 10) {  // too few for the approximation: pooled
          rest_counted += counted[i], rest_expected += expected[i];
          continue;
        }
        chi_square += (counted[i] - expected[i]) * (counted[i] - expected[i]) / expected[i];
        ++cells;
      }
      if (rest_expected > 10) chi_square += (rest_counted - rest_expected) * (rest_counted - rest_expected) / rest_expected, ++cells;
      EXPECT_GT(chi_square_p(chi_square, cells - 1), 1e-4)
          << "n = " << exponent << ", " << degrees << " degrees: " << chi_square << " / " << cells;
    }
  }
}

}  // namespace
}  // namespace earshot
