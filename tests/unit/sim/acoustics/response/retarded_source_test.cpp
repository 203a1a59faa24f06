// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/response/retarded_source.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "sim/base/random.h"

namespace earshot {
namespace {

constexpr double kSoundMPerS = 343.2;

/// A point of the ball of this radius, or one on its sphere.
glm::dvec3 drawn_vector(const RandomStream& random, std::uint32_t draw, double radius, bool on_sphere = false) {
  const auto u = random.uniform4(draw);
  const double z = 2.0 * static_cast<double>(u[0]) - 1, angle = 2 * std::numbers::pi * static_cast<double>(u[1]), r = std::sqrt(1 - z * z);
  return (on_sphere ? radius : radius * static_cast<double>(u[2])) * glm::dvec3(r * std::cos(angle), r * std::sin(angle), z);
}

/// The delay of what is heard at time 0 from a point that is at `at` by then and has moved evenly: the quadratic in closed form.
double exact_delay_s(glm::dvec3 listener, glm::dvec3 at, glm::dvec3 velocity) {
  const glm::dvec3 apart = listener - at;
  const double a = kSoundMPerS * kSoundMPerS - glm::dot(velocity, velocity), b = glm::dot(apart, velocity);
  return (b + std::sqrt(b * b + a * glm::dot(apart, apart))) / a;
}

TEST(RetardedSource, EmissionTimeSolvesTheQuadratic) {
  for (std::uint32_t i = 0; i < 200; ++i) {
    const RandomStream random(1, Purpose::test, i);
    const glm::dvec3 listener = drawn_vector(random, 0, 100), at = drawn_vector(random, 1, 100),
                     velocity = drawn_vector(random, 2, 0.8 * kSoundMPerS);
    const double found_s = emission_time_s([&](double t_s) { return at + t_s * velocity; }, listener, 0, kSoundMPerS);
    EXPECT_NEAR(-found_s, exact_delay_s(listener, at, velocity), 1e-9);
  }
}

// Straight paths and those by one and two planes: each as long as from the moving image, whatever path the place was retarded for.
TEST(RetardedSource, EachPathIsRetardedByItsOwnDelay) {
  for (std::uint32_t i = 0; i < 200; ++i) {
    const RandomStream random(2, Purpose::test, i);
    const glm::dvec3 listener = drawn_vector(random, 0, 30), at = drawn_vector(random, 1, 30), velocity = drawn_vector(random, 2, 100);
    const auto place = [&](double t_s) { return at + t_s * velocity; };
    const double emitted_s = emission_time_s(place, listener, 0, kSoundMPerS);
    EnergyResponse response;
    response.speed_of_sound_m_per_s = static_cast<float>(kSoundMPerS);
    std::vector<double> exact_m;
    for (int planes = 0; planes <= 2; ++planes) {
      // The mirrors one after the other, of points and of directions.
      const auto mirrored = [&](glm::dvec3 v, bool is_point) {
        for (int plane = 0; plane < planes; ++plane) {
          const auto draw = static_cast<std::uint32_t>(10 + plane);
          const glm::dvec3 normal = drawn_vector(random, draw, 1, true);
          const double offset = is_point ? 20.0 * static_cast<double>(random.uniform(20 + draw)) : 0;
          v -= 2 * (glm::dot(normal, v) - offset) * normal;
        }
        return v;
      };
      const auto mirrored_back = [&](glm::dvec3 v) {
        for (int plane = planes - 1; plane >= 0; --plane) {
          const glm::dvec3 normal = drawn_vector(random, static_cast<std::uint32_t>(10 + plane), 1, true);
          v -= 2 * glm::dot(normal, v) * normal;
        }
        return v;
      };
      const glm::dvec3 image = mirrored(place(emitted_s), true);
      Arrival arrival;
      arrival.order = planes;
      arrival.distance_m = static_cast<float>(glm::distance(listener, image));
      arrival.departure = glm::vec3(mirrored_back(glm::normalize(listener - image)));
      arrival.amplitude.fill(1.f / arrival.distance_m);
      response.arrivals.push_back(arrival);
      exact_m.push_back(kSoundMPerS * exact_delay_s(listener, mirrored(at, true), mirrored(velocity, false)));
    }
    retard_arrivals(place, emitted_s, 0, response);
    float before_m = 0;
    for (const Arrival& arrival : response.arrivals) {
      const double expected_m = exact_m[static_cast<std::size_t>(arrival.order)];
      EXPECT_NEAR(arrival.distance_m, expected_m, 1e-5 * (expected_m + 50)) << arrival.order;
      EXPECT_NEAR(arrival.amplitude[0] * arrival.distance_m, 1, 1e-5);
      EXPECT_GE(arrival.distance_m, before_m);
      before_m = arrival.distance_m;
    }
  }
}

}  // namespace
}  // namespace earshot
