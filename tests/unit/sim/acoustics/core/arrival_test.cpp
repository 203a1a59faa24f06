// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/core/arrival.h"

#include <gtest/gtest.h>

#include <array>

namespace earshot {
namespace {

TEST(PathIdentity, TellsPathsApartByKindAndByWhatTheyMeetInWhichOrder) {
  const std::array<std::uint32_t, 2> forward = {3, 7}, backward = {7, 3};
  const auto identity = [](ArrivalKind kind, std::span<const std::uint32_t> met) { return path_identity(kind, met); };
  EXPECT_EQ(identity(ArrivalKind::reflection, forward), identity(ArrivalKind::reflection, forward));
  EXPECT_NE(identity(ArrivalKind::reflection, forward), identity(ArrivalKind::reflection, backward));
  EXPECT_NE(identity(ArrivalKind::reflection, forward), identity(ArrivalKind::diffraction, forward));
  EXPECT_NE(identity(ArrivalKind::reflection, forward), identity(ArrivalKind::reflection, std::span(forward).first(1)));
  EXPECT_NE(identity(ArrivalKind::direct, {}), 0u) << "0 means not known";
}

TEST(PathIdentity, TheStraightLineIsOnePathWithAndWithoutAWall) {
  EXPECT_EQ(path_identity(ArrivalKind::direct, {}), path_identity(ArrivalKind::transmission, {}));
  EXPECT_NE(path_identity(ArrivalKind::direct, {}), path_identity(ArrivalKind::reflection, {}));
}

}  // namespace
}  // namespace earshot
