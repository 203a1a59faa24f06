// SPDX-License-Identifier: Apache-2.0
#include "tests/support/envs/house_navigation.h"

namespace earshot {
namespace {

TEST(HouseNavigation, EveryRoomIsReached) {
  for (int seed = 0; seed < 15; ++seed)
    for (const char* setting : {",rooms=2,area_m2=24", ",rooms=3,area_m2=36"}) expect_navigable(std::to_string(seed) + setting);
  for (const char* spec : {"0", "1", "7,rooms=1,area_m2=12", "3,rooms=16,area_m2=96"}) expect_navigable(spec);
}

TEST(HouseNavigation, DetailCutsNothingOff) {
  for (const char* spec : {"7,rooms=8,area_m2=140", "3,rooms=2,area_m2=24"}) expect_navigable(spec, ",detail_m=0.12");
}

}  // namespace
}  // namespace earshot
