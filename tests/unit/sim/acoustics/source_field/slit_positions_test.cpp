// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>

#include "tests/support/acoustics/slit_rooms.h"

/// Fields behind walls that are nearly closed, however the wall lies in the grid.  A cell of both sides was 7 to 14 dB too loud.
namespace earshot {
namespace {

using slits::DividedRoom;

/// A place behind the wall, 0.35 to 0.6 m from it or anywhere on that side.
glm::vec3 drawn_place(const DividedRoom& room, std::uint32_t number, bool is_near) {
  const RandomStream random(14, Purpose::test, number);
  const auto draw = [&](std::uint32_t index) { return static_cast<double>(random.uniform((is_near ? 0u : 3u) + index)); };
  const double y = 0.3 + (DividedRoom::kWidth - 0.6) * draw(0), z = 0.3 + (DividedRoom::kHeight - 0.6) * draw(1);
  const double first = room.wall_x(y) + 0.35, last = is_near ? first + 0.25 : DividedRoom::kLength - 0.3;
  return rooms::point(first + (last - first) * draw(2), y, z);
}

// Walls, angles, doors and cells of 0.4 to 1 m drawn at random.
TEST(SourceFieldSlitPositions, TenWallsAreAsLoudAsByPaths) {
  for (std::uint32_t number = 16; number < 26; ++number) {
    const auto [room, cell_m] = DividedRoom::drawn(number);
    SCOPED_TRACE(number);
    slits::expect_levels_of_paths(room.scene(), std::array{drawn_place(room, number, true)}, std::array{cell_m}, 8192, 0.25);
  }
}

TEST(SourceFieldSlitPositions, FortyWallsAreAsLoudAsByPaths) {
  for (std::uint32_t number = 0; number < 40; ++number) {
    const auto [room, cell_m] = DividedRoom::drawn(number);
    SCOPED_TRACE(number);
    std::printf("%2u: ", number);
    const std::array places{drawn_place(room, number, true), drawn_place(room, number, false)};
    slits::expect_levels_of_paths(room.scene(), places, std::array{cell_m}, 16'384, 0.2);
  }
}

}  // namespace
}  // namespace earshot
