// SPDX-License-Identifier: Apache-2.0
#include "tests/support/acoustics/door_bias.h"

namespace earshot {
namespace {

// The first of the pairs of SourceFieldDoorsSlow.  The cone of sound behind a door is narrower than a cell of 1 m: in its middle a field
// has less of the other room's sound.
TEST(SourceFieldDoors, ErrByLittleBesideADoor) {
  for (const int side : {-1, 1}) {
    const field_rooms::DoorBias bias = field_rooms::door_bias(2, side, 2, 4096);
    EXPECT_LT(std::fabs(bias.t20), 0.10) << side;
    EXPECT_LT(std::fabs(bias.edt), 0.20) << side;
  }
}

}  // namespace
}  // namespace earshot
