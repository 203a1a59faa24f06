// SPDX-License-Identifier: Apache-2.0
#include "sim/audio/measured/measured_spheres.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

struct DrawnHead {
  std::vector<glm::vec3> direction;
  std::vector<float> distance_m;
};

/// Several measurements within about a tenth of a degree of each of some directions, at distances that differ by a few per cent.
DrawnHead drawn_head(std::uint32_t number, double jitter_deg) {
  const RandomStream random(2027, Purpose::test, number);
  std::uint32_t draws = 0;
  const auto draw = [&] { return static_cast<double>(random.uniform(draws++)); };
  DrawnHead head;
  for (int d = 0; d < 40; ++d) {
    const double azimuth = 2 * std::numbers::pi * draw(), height = 1.9 * draw() - 0.95, flat = std::sqrt(1 - height * height);
    const glm::dvec3 at(flat * std::cos(azimuth), height, flat * std::sin(azimuth));
    for (int copy = 0; copy < 5; ++copy) {
      const glm::dvec3 off = jitter_deg * kDegree * (2.0 * glm::dvec3(draw(), draw(), draw()) - 1.0);
      head.direction.emplace_back(glm::normalize(at + off));
      head.distance_m.push_back(static_cast<float>(1.5 + 0.05 * draw()));
    }
  }
  return head;
}

TEST(MeasuredSpheres, NoTwoDirectionsAreAlikeHoweverCopiesLie) {
  for (std::uint32_t number = 0; number < 20; ++number) {
    const DrawnHead head = drawn_head(number, 0.02 * (1 + number % 10));
    const auto spheres = sort_into_spheres(head.direction, head.distance_m);
    ASSERT_EQ(spheres.size(), 1u);
    const auto& directions = spheres[0].directions;
    std::size_t copies = 0;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      copies += directions[i].copies.size();
      for (std::size_t j = 0; j < i; ++j)
        EXPECT_GT(glm::length(glm::dvec3(directions[i].direction) - glm::dvec3(directions[j].direction)), 0.099 * kDegree);
    }
    EXPECT_EQ(copies, head.direction.size());
  }
}

// Where the file states no distances every copy counts.
TEST(MeasuredSpheres, CopiesOfUnknownDistanceAllCount) {
  DrawnHead head = drawn_head(1, 0.0);
  std::ranges::fill(head.distance_m, 0.f);
  const auto spheres = sort_into_spheres(head.direction, head.distance_m);
  ASSERT_EQ(spheres.size(), 1u);
  EXPECT_EQ(spheres[0].distance_m, 0);
  ASSERT_EQ(spheres[0].directions.size(), 40u);
  for (const MeasuredDirection& measured : spheres[0].directions) EXPECT_EQ(measured.copies.size(), 5u);
}

}  // namespace
}  // namespace earshot
