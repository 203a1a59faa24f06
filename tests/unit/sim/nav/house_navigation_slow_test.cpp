// SPDX-License-Identifier: Apache-2.0
#include "tests/support/envs/house_navigation.h"

namespace earshot {
namespace {

TEST(HouseNavigationSlow, EveryTrainingHouseIsNavigable) {
  for (int seed = 0; seed <= 500; ++seed)
    for (const char* setting : {",rooms=2,area_m2=24", ",rooms=3,area_m2=36"}) expect_navigable(std::to_string(seed) + setting);
}

TEST(HouseNavigationSlow, EveryDrawnHouseIsNavigable) {
  for (int seed = 0; seed < 60; ++seed) expect_navigable(std::to_string(seed));
}

TEST(HouseNavigationSlow, EveryTightHouseIsNavigable) {
  for (int seed = 0; seed < 60; ++seed) {
    const int rooms = 2 + seed % 15;
    expect_navigable(std::to_string(seed) + ",rooms=" + std::to_string(rooms) + ",area_m2=" + std::to_string(6 * rooms));
  }
}

}  // namespace
}  // namespace earshot
