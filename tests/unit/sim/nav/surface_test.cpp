// SPDX-License-Identifier: Apache-2.0
#include "sim/nav/surface.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

namespace earshot {
namespace {

/// A floor of 4 x 4 m at 0 m, a ramp of 4 m length at its side x = 4 up to 3 m, and a gallery at 3 m that lies over the floor and is joined
/// to nothing.
Surface floor_ramp_and_gallery() {
  const std::vector<glm::dvec3> vertices{{0, 0, 0}, {4, 0, 0}, {4, 0, 4}, {0, 0, 4}, {8, 3, 0},
                                         {8, 3, 4}, {0, 3, 0}, {4, 3, 0}, {4, 3, 4}, {0, 3, 4}};
  constexpr int kWall = Surface::kWall;
  const auto quad = [](std::array<int, 4> corners, std::array<int, 4> neighbours) {
    Surface::Polygon polygon{.num_corners = 4};
    for (std::size_t i = 0; i < 4; ++i) {
      polygon.corners[i] = corners[i];
      polygon.neighbours[i] = neighbours[i];
    }
    return polygon;
  };
  // Counter-clockwise in (x, z).
  return {vertices,
          {quad({0, 1, 2, 3}, {kWall, 1, kWall, kWall}), quad({1, 4, 5, 2}, {kWall, kWall, kWall, 0}),
           quad({6, 7, 8, 9}, {kWall, kWall, kWall, kWall})}};
}

TEST(Surface, AWalkArrivesOnItsOwnStoreyAlone) {
  const Surface surface = floor_ramp_and_gallery();
  EXPECT_EQ(surface.num_islands(), 2);
  const glm::dvec3 from{1, 0, 1};
  const Surface::Walk along = surface.walk(0, from, {3, 0, 3});
  EXPECT_TRUE(along.arrived);
  EXPECT_NEAR(along.length_m, std::sqrt(8.0), 1e-12);
  // The same places seen from above, on the gallery over them.
  for (const glm::dvec3 above : {glm::dvec3{3, 3, 3}, glm::dvec3{1, 3, 1}, glm::dvec3{3.9, 3, 0.1}})
    EXPECT_FALSE(surface.walk(0, from, above).arrived) << above.x << " " << above.z;
  EXPECT_FALSE(surface.walk(2, {1, 3, 1}, {3, 0, 3}).arrived) << "nor down through the gallery";
}

TEST(Surface, ARampLeadsUp) {
  const Surface surface = floor_ramp_and_gallery();
  const Surface::Walk up = surface.walk(0, {2, 0, 2}, {7.2, 2.4, 2});
  EXPECT_TRUE(up.arrived);
  EXPECT_EQ(up.polygon, 1);
  EXPECT_NEAR(up.length_m, 2 + 4, 1e-9);  // 3.2 m along, 2.4 m up
}

}  // namespace
}  // namespace earshot
