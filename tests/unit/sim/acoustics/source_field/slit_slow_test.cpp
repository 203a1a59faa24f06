// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>

#include "tests/support/acoustics/slit_rooms.h"

/// As slit_test.cpp, at more places, by more rays.
namespace earshot {
namespace {

using rooms::point;

/// Close to the wall at the doorway and beside it, near the floor and the ceiling, and across the room.
const std::array<glm::vec3, 12> kPlaces{point(4.0, 1.95, 1.5), point(4.0, 2.3, 1.2), point(4.0, 1.0, 1.5), point(4.0, 3.4, 1.0),
                                        point(4.0, 1.9, 0.4),  point(4.1, 2.0, 2.3), point(4.7, 2.0, 1.5), point(5.2, 0.5, 1.7),
                                        point(5.5, 3.3, 0.6),  point(6.4, 2.1, 1.5), point(7.0, 0.6, 1.2), point(7.1, 3.6, 2.2)};

constexpr std::array kCellsSlow{1.f, 0.5f};

TEST(SourceFieldSlitSlow, AsPathsBehindASlitUnderADoor) {
  slits::expect_levels_of_paths(slits::DividedRoom().scene(), kPlaces, kCellsSlow, 49'152, 0.1);
}

TEST(SourceFieldSlitSlow, AsPathsBehindADoorAjar) {
  slits::expect_levels_of_paths(slits::DividedRoom{.door = slits::DividedRoom::Door::ajar, .gap_m = 0.03}.scene(), kPlaces, kCellsSlow,
                                49'152, 0.1);
}

}  // namespace
}  // namespace earshot
