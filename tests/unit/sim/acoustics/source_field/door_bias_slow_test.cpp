// SPDX-License-Identifier: Apache-2.0
#include "tests/support/acoustics/door_bias.h"

namespace earshot {
namespace {

// Ten drawn pairs of a dead and a live room.
TEST(SourceFieldDoorsSlow, ErrByLittleInTenPairsOfRooms) {
  for (const int side : {-1, 1}) {
    const field_rooms::DoorBias bias = field_rooms::door_bias(10, side, 4, 16'384);
    EXPECT_LT(std::fabs(bias.t20), 0.06) << side;
    EXPECT_LT(std::fabs(bias.edt), 0.15) << side;
    // 95 % of independent values; the seeds of a pair share its bias.
    EXPECT_GE(bias.covered, 0.85 * bias.values) << side;
  }
}

}  // namespace
}  // namespace earshot
