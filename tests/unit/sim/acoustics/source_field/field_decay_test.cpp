// SPDX-License-Identifier: Apache-2.0
#include "tests/support/acoustics/field_decay.h"

namespace earshot {
namespace {

using namespace field_decay;

/// With few paths; field_decay_slow_test.cpp has more, and the source in the live room.
TEST(SourceFieldDecay, IsThatOfPathsInTwoRoomsWithADoor) {
  expect_decay_of_paths(kInDead, {.fields = 4, .path_runs = 4, .path_rays = 1024, .most_t20_error = 0.03, .most_curve_error_db = 0.3},
                        std::array{within_what_is_heard(1.f), within_what_is_heard(0.5f)});
}

}  // namespace
}  // namespace earshot
