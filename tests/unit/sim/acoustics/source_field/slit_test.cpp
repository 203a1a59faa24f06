// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>

#include "tests/support/acoustics/slit_rooms.h"

/// Fields behind walls that are nearly closed.  Cells that joined what one line joins were 18 dB too loud 0.3 m behind the slit.
namespace earshot {
namespace {

using rooms::point;

/// 0.3 m behind the wall, at the door and beside it, and across the room.
const std::array<glm::vec3, 4> kPlaces{point(4.0, 1.95, 1.5), point(4.0, 1.0, 1.5), point(4.1, 2.0, 2.3), point(5.5, 3.3, 0.6)};

constexpr std::array kCells{1.f, 0.5f};

TEST(SourceFieldSlit, AsPathsBehindASlitUnderADoor) {
  slits::expect_levels_of_paths(slits::DividedRoom().scene(), kPlaces, kCells, 16'384, 0.15);
}

TEST(SourceFieldSlit, AsPathsBehindADoorAjar) {
  slits::expect_levels_of_paths(slits::DividedRoom{.door = slits::DividedRoom::Door::ajar, .gap_m = 0.03}.scene(), kPlaces, kCells, 16'384,
                                0.15);
}

}  // namespace
}  // namespace earshot
