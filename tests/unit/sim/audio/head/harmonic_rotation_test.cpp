// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/head/harmonic_rotation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <vector>

#include "sim/audio/head/ambisonics.h"
#include "sim/base/errors.h"
#include "sim/base/random.h"
#include "tests/support/acoustics/directions.h"

namespace earshot {
namespace {

glm::dquat random_turn(std::uint32_t index) {
  const RandomStream random(32, Purpose::test, index);
  const auto a = random.normal2(0), b = random.normal2(1);
  return glm::normalize(
      glm::dquat(static_cast<double>(a[0]), static_cast<double>(a[1]), static_cast<double>(b[0]), static_cast<double>(b[1])));
}

HarmonicRotation rotation_of(const ListenerOrientation& orientation, int order) {
  HarmonicRotation rotation(order);
  rotation.set(orientation);
  return rotation;
}

TEST(ListenerOrientation, HasTheSignsOfItsAngles) {
  const auto expect_near = [](glm::vec3 a, glm::vec3 b) { EXPECT_LT(glm::distance(a, b), 1e-6f) << a.x << ' ' << a.y << ' ' << a.z; };
  const ListenerOrientation left(90 * kDegree), up(0, 90 * kDegree, 0), right_ear_down(0, 0, 90 * kDegree);
  expect_near(left.world_to_local({0, 0, -1}), {1, 0, 0});  // a front source is now at the right
  expect_near(up.world_to_local({0, 1, 0}), {0, 0, -1});    // what was above is in front
  expect_near(up.world_to_local({0, 0, -1}), {0, -1, 0});   // the front is below
  expect_near(right_ear_down.world_to_local({0, -1, 0}), {1, 0, 0});
  expect_near(right_ear_down.world_to_local({0, 0, -1}), {0, 0, -1});
  // Pitch is about the listener's own ears, whichever way it heads.
  expect_near(ListenerOrientation(90 * kDegree, 90 * kDegree, 0).world_to_local({0, 1, 0}), {0, 0, -1});
  expect_near(ListenerOrientation(90 * kDegree, 30 * kDegree, 0).world_to_local({0, 0, -1}), {1, 0, 0});
}

TEST(ListenerOrientation, QuaternionHeadingAndAnglesAgree) {
  const ListenerOrientation heading(0.7), angles(0.7, 0.0, 0.0), quaternion(heading.local_to_world() * 3.0), turned(0.7, -0.4, 1.9);
  EXPECT_TRUE(heading.level() && angles.level());
  for (std::uint32_t i = 0; i < 50; ++i) {
    const glm::vec3 d = random_direction(31, i);
    EXPECT_EQ(heading.world_to_local(d), to_head_axes(d, 0.7));
    EXPECT_LT(glm::distance(heading.world_to_local(d), quaternion.world_to_local(d)), 1e-6f);
    EXPECT_LT(glm::distance(turned.local_to_world(turned.world_to_local(d)), d), 1e-6f);
    EXPECT_LT(glm::distance(heading.local_to_world(heading.world_to_local(d)), d), 1e-6f);
  }
  EXPECT_THROW(ListenerOrientation(glm::dquat(0, 0, 0, 0)), InputError);
}

// Rotating the field equals the field of the turned direction, for every order, turn and direction: the recursion against the harmonics.
TEST(OracleO28, RotationOfTheFieldIsTheFieldOfTheTurnedDirection) {
  for (std::uint32_t i = 0; i < 40; ++i) {
    const ListenerOrientation orientation(random_turn(i));
    auto field = harmonics(random_direction(31, i), 9);
    rotation_of(orientation, 9).apply(field);
    const auto expected = harmonics(orientation.world_to_local(random_direction(31, i)), 9);
    for (std::size_t c = 0; c < field.size(); ++c) EXPECT_NEAR(field[c], expected[c], 5e-5) << c;  // float direction, slope l^2, size 4
  }
}

TEST(OracleO28, YawTurnsAsRotateToHeadingDoes) {
  for (const double heading_rad : {0.3, -2.0, 90 * kDegree}) {
    auto field = harmonics(random_direction(31, 5), 9), by_heading = field;
    rotation_of(ListenerOrientation(heading_rad), 9).apply(field);
    rotate_to_heading(by_heading, 9, heading_rad);
    for (std::size_t c = 0; c < field.size(); ++c) EXPECT_NEAR(field[c], by_heading[c], 2e-6);
  }
  // Turning left by 90 degrees moves a front source to the right: ACN 1 becomes -sqrt 3, ACN 3 becomes 0.
  auto front = harmonics({0, 0, -1}, 1);
  rotation_of(ListenerOrientation(90 * kDegree), 1).apply(front);
  EXPECT_NEAR(front[0], 1.0, 1e-7);
  EXPECT_NEAR(front[1], -1.7320508, 1e-6);
  EXPECT_NEAR(front[3], 0.0, 1e-6);
}

/// Largest difference of two matrices of all orders.
double distance(const HarmonicRotation& a, const HarmonicRotation& b) {
  double largest = 0;
  for (int l = 0; l <= a.order(); ++l)
    for (int m = -l; m <= l; ++m)
      for (int n = -l; n <= l; ++n) largest = std::max(largest, std::abs(a.at(l, m, n) - b.at(l, m, n)));
  return largest;
}

TEST(OracleO28, RotationsAreAGroup) {
  for (std::uint32_t i = 0; i < 20; ++i) {
    const glm::dquat a = random_turn(2 * i), b = random_turn(2 * i + 1);
    const HarmonicRotation first = rotation_of(ListenerOrientation(a), 9), second = rotation_of(ListenerOrientation(b), 9);
    // Turn by a, then by b about its own axes: world = a b own.
    const HarmonicRotation both = rotation_of(ListenerOrientation(a * b), 9);
    for (int l = 0; l <= 9; ++l) {
      for (int m = -l; m <= l; ++m) {
        for (int n = -l; n <= l; ++n) {
          double sum = 0, gram = 0;
          for (int k = -l; k <= l; ++k) {
            sum += second.at(l, m, k) * first.at(l, k, n);
            gram += first.at(l, m, k) * first.at(l, n, k);
          }
          ASSERT_NEAR(sum, both.at(l, m, n), 1e-10) << l;
          ASSERT_NEAR(gram, m == n ? 1.0 : 0.0, 1e-10) << l;  // orthogonal: power per order is kept
        }
      }
    }
  }
  const HarmonicRotation still(9);
  EXPECT_LT(distance(rotation_of(ListenerOrientation(2.0 * std::numbers::pi), 9), still), 1e-12);
  EXPECT_LT(distance(rotation_of(ListenerOrientation(glm::dquat(-1, 0, 0, 0)), 9), still), 1e-12);
  EXPECT_GT(distance(rotation_of(ListenerOrientation(0.1), 9), still), 0.1);
}

TEST(OracleO28, ThirtySixTurnsOfTenDegreesReturnToTheStart) {  // docs/evidence/stability.md, H-58
  for (const ListenerOrientation& orientation :
       {ListenerOrientation(10 * kDegree), ListenerOrientation(0, 10 * kDegree, 0), ListenerOrientation(0, 0, 10 * kDegree)}) {
    const HarmonicRotation step = rotation_of(orientation, 9);
    const auto start = harmonics(random_direction(31, 9), 9);
    auto field = start;
    for (int i = 0; i < 36; ++i) step.apply(field);
    for (std::size_t c = 0; c < field.size(); ++c) EXPECT_NEAR(field[c], start[c], 1e-5);  // 36 roundings of a float of size 4
  }
}

TEST(OracleO28, SignalsTurnLikeCoefficients) {
  HarmonicRotation rotation = rotation_of(ListenerOrientation(random_turn(3)), 4);
  constexpr std::size_t length = 600;  // more than two blocks
  std::vector<std::vector<float>> signals(25, std::vector<float>(length));
  std::vector<std::span<float>> channels;
  const RandomStream random(33, Purpose::test);
  for (std::size_t c = 0; c < 25; ++c) {
    for (std::size_t n = 0; n < length; ++n) signals[c][n] = random.uniform(static_cast<std::uint32_t>(c * length + n)) - 0.5f;
    channels.emplace_back(signals[c]);
  }
  const auto before = signals;
  rotation.apply(channels, 550);
  for (const std::size_t n : {0u, 255u, 256u, 549u, 550u, 599u}) {
    std::vector<float> field(25);
    for (std::size_t c = 0; c < 25; ++c) field[c] = before[c][n];
    if (n < 550) rotation.apply(field);
    for (std::size_t c = 0; c < 25; ++c) EXPECT_NEAR(signals[c][n], field[c], 1e-6) << n;
  }
}

// Sum of e d over sum of e: 1 for one plane wave, 0 for a diffuse field.
TEST(OracleO28, EnergyVectorOfFirstOrder) {
  const auto energy_vector = [](std::span<const float> moments) {
    return glm::length(glm::vec3(-moments[1], moments[2], -moments[3])) / (std::numbers::sqrt3_v<float> * moments[0]);
  };
  EXPECT_NEAR(energy_vector(harmonics(random_direction(31, 1), 1)), 1.f, 1e-6f);
  std::vector<float> sum(4, 0.f);
  constexpr int count = 4000;  // midpoints in height, golden angle
  for (int i = 0; i < count; ++i) {
    const double height = (2.0 * i + 1.0) / count - 1.0, angle = 2.0 * std::numbers::pi * std::fmod(i * std::numbers::phi, 1.0);
    const double radius = std::sqrt(1.0 - height * height);
    const auto h = harmonics(
        {static_cast<float>(radius * std::cos(angle)), static_cast<float>(height), static_cast<float>(radius * std::sin(angle))}, 1);
    for (std::size_t c = 0; c < 4; ++c) sum[c] += h[c] / count;
  }
  EXPECT_NEAR(energy_vector(sum), 0.f, 1e-3f);
}

}  // namespace
}  // namespace earshot
