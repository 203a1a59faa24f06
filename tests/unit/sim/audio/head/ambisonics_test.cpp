// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/ambisonics.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "sim/base/random.h"
#include "tests/support/acoustics/directions.h"
#include "tests/support/acoustics/harmonic_table.h"

namespace earshot {
namespace {

using namespace harmonic_table;

TEST(SphericalHarmonics, MatchTheTableO28) {
  for (const TableRow& row : kTable) {
    const auto values = harmonics(direction_of(row.azimuth_deg, row.elevation_deg), 3);
    for (std::size_t i = 0; i < 16; ++i)
      EXPECT_NEAR(values[i], row.values[i], 6e-6) << row.azimuth_deg << " acn " << i;  // half a unit of the last place
  }
}

TEST(SphericalHarmonics, SquaresSumToTheChannelCountO28) {
  for (int order = 0; order <= 9; ++order) {
    for (std::uint32_t i = 0; i < 200; ++i) {
      double sum = 0;
      for (const float value : harmonics(random_direction(11, i), order)) sum += static_cast<double>(value) * value;
      EXPECT_NEAR(sum, (order + 1) * (order + 1),
                  2e-5 * (order + 1) * (order + 1));  // a float unit vector is off by 1e-7, to the 18th power
    }
  }
}

// The addition theorem: sum over m of Y(a) Y(b) = (2l + 1) P_l(a . b).  Independent of our recursion: Bonnet's.
TEST(SphericalHarmonics, ObeyTheAdditionTheorem) {
  for (std::uint32_t i = 0; i < 100; ++i) {
    const glm::vec3 a = random_direction(11, 2 * i), b = random_direction(11, 2 * i + 1);
    const auto ya = harmonics(a, 9), yb = harmonics(b, 9);
    const double cosine = glm::dot(glm::dvec3(a), glm::dvec3(b));
    double before = 0, legendre = 1;
    for (int l = 0; l <= 9; ++l) {
      double sum = 0;
      for (int m = -l; m <= l; ++m) sum += static_cast<double>(ya[l * l + l + m]) * yb[l * l + l + m];
      EXPECT_NEAR(sum, (2 * l + 1) * legendre, 1e-4);
      const double next = ((2 * l + 1) * cosine * legendre - l * before) / (l + 1);
      before = legendre;
      legendre = next;
    }
  }
}

TEST(SphericalHarmonics, Sn3dDividesByTheRootOfTwoLPlusOne) {
  EXPECT_FLOAT_EQ(sn3d_from_n3d(0), 1.f);
  for (const int channel : {1, 2, 3}) EXPECT_FLOAT_EQ(sn3d_from_n3d(channel), 0.57735027f);
  for (const int channel : {4, 8}) EXPECT_FLOAT_EQ(sn3d_from_n3d(channel), 0.44721360f);
  for (const int channel : {9, 15}) EXPECT_FLOAT_EQ(sn3d_from_n3d(channel), 0.37796447f);
}

TEST(HeadAxes, TurningLeftMovesAFrontSourceToTheRight) {
  const glm::vec3 front(0, 0, -1);
  const glm::vec3 turned = to_head_axes(front, 90 * kDegree);
  EXPECT_NEAR(turned.x, 1, 1e-7);
  EXPECT_NEAR(turned.y, 0, 1e-7);
  EXPECT_NEAR(turned.z, 0, 1e-7);
  // What was on the left (-x) is now in front.
  EXPECT_NEAR(to_head_axes({-1, 0, 0}, 90 * kDegree).z, -1, 1e-7);
  EXPECT_EQ(to_head_axes({0.6f, 0.64f, -0.48f}, 0.0), glm::vec3(0.6f, 0.64f, -0.48f));
}

TEST(Rotation, TurningLeftMovesAFrontSourceToTheRightO28) {
  auto field = harmonics({0, 0, -1}, 1);
  rotate_to_heading(field, 1, 90 * kDegree);
  EXPECT_NEAR(field[0], 1, 1e-7);
  EXPECT_NEAR(field[1], -1.7320508, 1e-6);
  EXPECT_NEAR(field[2], 0, 1e-7);
  EXPECT_NEAR(field[3], 0, 1e-6);
}

TEST(Rotation, OfTheFieldEqualsTheFieldOfTheTurnedDirection) {
  for (std::uint32_t i = 0; i < 50; ++i) {
    const double heading = (37.0 * i - 500.0) * kDegree;
    auto field = harmonics(random_direction(11, i), 9);
    rotate_to_heading(field, 9, heading);
    const auto expected = harmonics(to_head_axes(random_direction(11, i), heading), 9);
    for (std::size_t c = 0; c < field.size(); ++c) EXPECT_NEAR(field[c], expected[c], 3e-5) << c;  // float direction, m <= 9
  }
}

TEST(Rotation, KeepsThePowerOfEachOrder) {
  const auto field = harmonics(random_direction(11, 3), 9);
  auto turned = field;
  rotate_to_heading(turned, 9, 0.7);
  for (int l = 0; l <= 9; ++l) {
    double before = 0, after = 0;
    for (int c = l * l; c < (l + 1) * (l + 1); ++c) {
      before += static_cast<double>(field[c]) * field[c];
      after += static_cast<double>(turned[c]) * turned[c];
    }
    EXPECT_NEAR(after / before, 1.0, 1e-6);
  }
}

TEST(Rotation, IsAGroup) {
  const auto field = harmonics(random_direction(11, 4), 9);
  auto twice = field, once = field, full = field, steps = field;
  rotate_to_heading(twice, 9, 0.4);
  rotate_to_heading(twice, 9, 1.1);
  rotate_to_heading(once, 9, 1.5);
  rotate_to_heading(full, 9, 2.0 * std::numbers::pi);
  for (int i = 0; i < 36; ++i) rotate_to_heading(steps, 9, 10 * kDegree);
  for (std::size_t c = 0; c < field.size(); ++c) {
    EXPECT_NEAR(twice[c], once[c], 2e-6);
    EXPECT_NEAR(full[c], field[c], 1e-6);
    EXPECT_NEAR(steps[c], field[c], 1e-5);  // 36 roundings of a float of size 3
  }
}

// N3D has unit mean power per channel over the sphere, and channels are orthogonal: midpoint rule in sin(elevation) x azimuth.
TEST(SphericalHarmonics, AreOrthonormalOverTheSphere) {
  constexpr int num_z = 400, num_azimuth = 24;  // azimuth is exact for |m| sums below 24
  std::array<std::array<double, 16>, 16> gram{};
  for (int i = 0; i < num_z; ++i) {
    const double elevation = std::asin((2.0 * i + 1.0) / num_z - 1.0) / kDegree;
    for (int j = 0; j < num_azimuth; ++j) {
      const auto values = harmonics(direction_of(360.0 * j / num_azimuth, elevation), 3);
      for (std::size_t a = 0; a < 16; ++a)
        for (std::size_t b = 0; b < 16; ++b) gram[a][b] += static_cast<double>(values[a]) * values[b] / (num_z * num_azimuth);
    }
  }
  for (std::size_t a = 0; a < 16; ++a)
    for (std::size_t b = 0; b < 16; ++b)
      EXPECT_NEAR(gram[a][b], a == b ? 1.0 : 0.0, 2e-4) << a << ' ' << b;  // midpoint error ~ 1 / num_z^2
}

}  // namespace
}  // namespace earshot
