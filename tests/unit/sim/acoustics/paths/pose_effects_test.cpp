// SPDX-License-Identifier: Apache-2.0
#include "sim/acoustics/paths/pose_effects.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/acoustics/effect_scenes.h"

namespace earshot {
namespace {

TEST(PoseEffects, CountsPerPose) {
  const auto where = effects::two_rooms_scene(0.9, 0.01);
  const AcousticScene scene(where.scene, AcousticConfig{});
  const EarlyCandidates candidates(scene, where.source);
  EffectCounters sum;
  for (const glm::vec3 listener : where.listeners) {
    const EnergyResponse response = effects::render(scene, candidates, listener);
    const bool in_sight =
        std::any_of(response.arrivals.begin(), response.arrivals.end(), [](const Arrival& a) { return a.kind == ArrivalKind::direct; });
    const bool through = std::any_of(response.arrivals.begin(), response.arrivals.end(),
                                     [](const Arrival& a) { return a.kind == ArrivalKind::transmission; });
    EXPECT_EQ(response.effects.poses, 1u);
    EXPECT_EQ(response.effects.in_sight, in_sight ? 1u : 0u);
    EXPECT_EQ(response.effects.transmission_skipped, in_sight ? 1u : 0u);
    EXPECT_EQ(through, !in_sight);
    EXPECT_EQ(response.effects.late_skipped, 0u);
    sum.add(response.effects);
  }
  EXPECT_EQ(sum.poses, where.listeners.size());
  EXPECT_GT(sum.in_sight, 0u);
  EXPECT_LT(sum.in_sight, sum.poses);
}

}  // namespace
}  // namespace earshot
