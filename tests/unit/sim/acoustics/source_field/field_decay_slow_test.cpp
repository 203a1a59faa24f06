// SPDX-License-Identifier: Apache-2.0
#include "tests/support/acoustics/field_decay.h"

namespace earshot {
namespace {

using namespace field_decay;

const Effort kMany{.fields = 8, .path_runs = 8, .path_rays = 8192, .most_t20_error = 0.02, .most_curve_error_db = 0.2};

TEST(SourceFieldDecaySlow, SourceInTheDeadRoomOfTwo) {
  expect_decay_of_paths(kInDead, kMany, std::array{within_what_is_heard(1.f), within_what_is_heard(0.5f)});
}

TEST(SourceFieldDecaySlow, SourceInTheLiveRoomOfTwo) { expect_decay_of_paths(kInLive, kMany, std::array{within_what_is_heard(1.f)}); }

}  // namespace
}  // namespace earshot
