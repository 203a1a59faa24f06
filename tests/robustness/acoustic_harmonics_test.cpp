// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <string>
#include <vector>

#include "sim/audio/head/ambisonics.h"
#include "sim/audio/head/harmonic_rotation.h"
#include "sim/base/random.h"

/// Spherical harmonics up to order nine: no factorial is ever formed, so nothing overflows.
namespace earshot {
namespace {

/// Rotations of every kind: about single axes, at the poles of the angles, and any.
std::vector<ListenerOrientation> orientations() {
  std::vector<ListenerOrientation> all = {ListenerOrientation()};
  for (const glm::dvec3 axis : {glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, 1)})
    for (const double degrees : {1e-6, 10.0, 89.9999999, 90.0, 90.0000001, 180.0, 270.0, 359.999999})
      all.emplace_back(glm::angleAxis(degrees * 3.14159265358979323846 / 180, axis));
  for (std::uint32_t i = 0; i < 30; ++i) {
    const auto a = RandomStream(1, Purpose::test, i).normal2(0), b = RandomStream(1, Purpose::test, i).normal2(1);
    all.emplace_back(glm::normalize(
        glm::dquat(static_cast<double>(a[0]), static_cast<double>(a[1]), static_cast<double>(b[0]), static_cast<double>(b[1]))));
  }
  return all;
}

TEST(H60_HarmonicRotation, IsOrthogonalInEveryOrder) {
  HarmonicRotation rotation(9);
  double worst = 0;
  for (const ListenerOrientation& orientation : orientations()) {
    rotation.set(orientation);
    for (int l = 0; l <= 9; ++l)
      for (int a = -l; a <= l; ++a)
        for (int b = -l; b <= l; ++b) {
          double product = 0;
          for (int n = -l; n <= l; ++n) product += rotation.at(l, a, n) * rotation.at(l, b, n);
          worst = std::max(worst, std::abs(product - (a == b ? 1.0 : 0.0)));
        }
  }
  EXPECT_LT(worst, 1e-12);  // the requirement is 1e-5
  RecordProperty("orthogonality", std::to_string(worst * 1e15) + "e-15");
}

TEST(H60_HarmonicRotation, CoefficientsInFloatLoseOneUnitInTheLastPlace) {
  HarmonicRotation rotation(9);
  double worst = 0, drift = 0;
  for (const ListenerOrientation& orientation : orientations()) {
    rotation.set(orientation);
    std::vector<float> field(100);
    for (std::uint32_t i = 0; i < 100; ++i) field[i] = RandomStream(2, Purpose::test, i).normal2(0)[0];
    const std::vector<float> before = field;
    rotation.apply(field);
    for (int l = 0; l <= 9; ++l) {
      long double power = 0, power_before = 0;
      for (int m = -l; m <= l; ++m) {
        long double exact = 0;
        for (int n = -l; n <= l; ++n)
          exact += static_cast<long double>(rotation.at(l, m, n)) * static_cast<long double>(before[l * l + l + n]);
        worst = std::max(worst, std::abs(static_cast<double>(static_cast<long double>(field[l * l + l + m]) - exact)));
        power += static_cast<long double>(field[l * l + l + m]) * static_cast<long double>(field[l * l + l + m]);
        power_before += static_cast<long double>(before[l * l + l + m]) * static_cast<long double>(before[l * l + l + m]);
      }
      drift = std::max(drift, std::abs(static_cast<double>(power / power_before - 1)));
    }
  }
  EXPECT_LT(worst, 5e-7);  // values up to 3
  EXPECT_LT(drift, 5e-7);  // energy of each order
  RecordProperty("coefficient", std::to_string(worst * 1e9) + "e-9");
}

TEST(H60_Harmonics, AdditionTheoremHoldsForEveryDirectionAndOrder) {
  // Sum of squares over an order is 2 l + 1 in N3D, at the poles and the seam too.
  std::vector<glm::vec3> directions = {{1, 0, 0},  {-1, 0, 0},    {0, 1, 0},       {0, -1, 0},    {0, 0, 1},
                                       {0, 0, -1}, {1e-7f, 1, 0}, {-1, 0, -1e-7f}, {0, 1, 1e-20f}};
  for (std::uint32_t i = 0; i < 2000; ++i) {
    const auto a = RandomStream(3, Purpose::test, i).normal2(0), b = RandomStream(3, Purpose::test, i).normal2(1);
    directions.push_back(glm::normalize(glm::vec3(a[0], a[1], b[0])));
  }
  std::vector<float> harmonics(100);
  double worst = 0;
  for (const glm::vec3 direction : directions) {
    spherical_harmonics_n3d(direction, 9, harmonics);
    for (int l = 0; l <= 9; ++l) {
      double sum = 0;
      for (int i = l * l; i < (l + 1) * (l + 1); ++i) {
        ASSERT_TRUE(std::isfinite(harmonics[i]));
        sum += static_cast<double>(harmonics[i]) * static_cast<double>(harmonics[i]);
      }
      worst = std::max(worst, std::abs(sum / (2 * l + 1) - 1));
    }
  }
  EXPECT_LT(worst, 1e-5);
  RecordProperty("addition_theorem", std::to_string(worst * 1e9) + "e-9");
}

}  // namespace
}  // namespace earshot
