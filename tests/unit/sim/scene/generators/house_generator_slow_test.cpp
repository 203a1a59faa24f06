// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "sim/scene/generators/house_generator.h"

namespace earshot {
namespace {

int count_objects(const TriangleMesh& mesh, const std::string& prefix) {
  return static_cast<int>(std::count_if(mesh.object_names.begin(), mesh.object_names.end(),
                                        [&](const std::string& name) { return name.rfind(prefix, 0) == 0; }));
}

// The settings that training uses, for every seed that it may draw; drawn sizes and every number of rooms for each fifth.
TEST(HouseGeneratorSlow, EverySeedGivesAHouse) {
  for (std::uint64_t seed = 0; seed <= 500; ++seed) {
    std::vector<std::pair<int, float>> settings{{2, 24.f}, {3, 36.f}};
    if (seed % 5 == 0) settings.insert(settings.end(), {{0, 0.f}, {static_cast<int>(1 + seed / 5 % 16), 0.f}});
    for (const auto& [rooms, area_m2] : settings) {
      const TriangleMesh mesh = generate_house({.seed = seed, .rooms = rooms, .area_m2 = area_m2});
      const int num_rooms = count_objects(mesh, "floor_");
      if (rooms > 0)
        EXPECT_EQ(num_rooms, rooms) << seed;
      else
        EXPECT_TRUE(num_rooms >= 4 && num_rooms <= 9) << seed;
      EXPECT_GE(count_objects(mesh, "doorframe_"), num_rooms - 1) << seed;
    }
  }
}

TEST(HouseGeneratorSlow, TightestAreaPerRoomStillGivesAHouse) {
  for (std::uint64_t seed = 0; seed < 60; ++seed)
    for (int rooms = 1; rooms <= 16; ++rooms)
      EXPECT_NO_THROW(generate_house({.seed = seed, .rooms = rooms, .area_m2 = std::max(12.f, 6.f * static_cast<float>(rooms))})) << rooms;
}

}  // namespace
}  // namespace earshot
