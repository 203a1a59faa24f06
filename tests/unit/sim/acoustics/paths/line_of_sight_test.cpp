// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/line_of_sight.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/support/acoustics/effect_scenes.h"

namespace earshot {
namespace {

using rooms::point;

std::size_t count(const std::vector<Arrival>& arrivals, ArrivalKind kind) {
  return static_cast<std::size_t>(std::count_if(arrivals.begin(), arrivals.end(), [&](const Arrival& a) { return a.kind == kind; }));
}

/// Two rooms with a door; the partition lets sound through.
AcousticConfig straight_paths_only() {
  AcousticConfig config;
  config.early = config.late = Switch::off;
  config.rir_length_s = 0.1f;
  return config;
}

TEST(LineOfSight, ThroughWallsOrDirectNeverBothNeverNeither) {
  const auto where = effects::two_rooms_scene(0.9, 0.01);
  const AcousticScene scene(where.scene, straight_paths_only());
  const EarlyCandidates candidates(scene, where.source);
  // Listeners at x = 7 m, one float apart, across the shadow boundary of the door jamb at (4.5, 1.55).
  const auto boundary = static_cast<float>(1.2 + (1.55 - 1.2) / (4.5 - 1.5) * (7 - 1.5));
  std::vector<float> at_y;
  float below = boundary, above = boundary;
  for (int i = 0; i < 200; ++i) {
    at_y.push_back(below = std::nextafter(below, 0.f));
    at_y.push_back(above = std::nextafter(above, 10.f));
  }
  for (int i = 1; i < 40; ++i) at_y.push_back(0.1f * static_cast<float>(i));
  std::size_t free = 0;
  EnergyResponse response;
  for (const float y : at_y) {
    const glm::vec3 listener = point(7, y, 1.5);
    compute_energy_response(scene, candidates, listener, response);
    const std::size_t direct = count(response.arrivals, ArrivalKind::direct), through = count(response.arrivals, ArrivalKind::transmission);
    EXPECT_EQ(direct + through, 1u) << y;
    EXPECT_EQ(response.effects.in_sight, direct) << y;
    EXPECT_EQ(in_line_of_sight(scene, where.source, listener), direct == 1) << y;
    EXPECT_EQ(in_line_of_sight(scene, listener, where.source), direct == 1) << y;
    free += direct;
  }
  EXPECT_GT(free, 100u);
  EXPECT_LT(free, at_y.size() - 100);
}

// A wrong answer on purpose: a consumer with a ray of its own would not follow it.
TEST(LineOfSight, PathsFollowTheAnswerThatTheyAreGiven) {
  const auto where = effects::two_rooms_scene(0.9, 0.01);
  AcousticConfig config = straight_paths_only();
  const AcousticScene scene(where.scene, config);
  const EarlyCandidates candidates(scene, where.source);
  const glm::vec3 free = where.listeners[0], blocked = where.listeners[3];
  ASSERT_TRUE(in_line_of_sight(scene, where.source, free));
  ASSERT_FALSE(in_line_of_sight(scene, where.source, blocked));
  std::array<double, 2> diffracted{};
  for (const bool in_sight : {false, true}) {
    for (const glm::vec3 listener : {free, blocked}) {
      std::vector<Arrival> arrivals;
      candidates.find_arrivals(scene, listener, in_sight, arrivals);
      EXPECT_EQ(count(arrivals, ArrivalKind::direct), in_sight ? 1u : 0u);
    }
    std::vector<Arrival> arrivals;
    candidates.diffraction().find_arrivals(scene, blocked, in_sight, arrivals);
    for (const Arrival& arrival : arrivals) diffracted[in_sight ? 1 : 0] += double{arrival.amplitude[5]} * arrival.amplitude[5];
  }
  // A listener in sight gets only what is near a shadow boundary, at 4 kHz little.
  EXPECT_GT(diffracted[0], 0.0);
  EXPECT_LT(diffracted[1], 0.5 * diffracted[0]);
}

TEST(LineOfSight, ASourceIsInSightOfItself) {
  const AcousticScene scene(rooms::shoe1(0.2, 0.5), {});
  EXPECT_TRUE(in_line_of_sight(scene, rooms::shoe1_source(), rooms::shoe1_source()));
  const AcousticScene nothing(rooms::empty(), {});
  EXPECT_TRUE(in_line_of_sight(nothing, {0, 0, 0}, {100, 0, 0}));
}

}  // namespace
}  // namespace earshot
