// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/preemption.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace earshot {
namespace {

PpoConfig config(double fraction, double least = 0.25) {
  PpoConfig ppo;
  ppo.preempt_fraction = fraction;
  ppo.preempt_least = least;
  return ppo;
}

/// Of eight workers: so many made all of 64 steps in 1 s and a little more each, the others 16 in 0.9 s.
std::vector<RolloutTime> rollouts(int whole) {
  std::vector<RolloutTime> all;
  for (int i = 0; i < 8; ++i)
    all.push_back(i < whole ? RolloutTime{.collect_s = 1 + 0.01 * i, .steps = 64} : RolloutTime{.collect_s = 0.9, .steps = 16});
  return all;
}

TEST(Preemption, IsOffByDefault) {
  const Preemption off(PpoConfig{}, 64);
  EXPECT_FALSE(off.is_on());
  EXPECT_FALSE(off.may_end_with(63));
}

TEST(Preemption, NeverBeforeTheLeastPart) {
  const Preemption quarter(config(0.6), 64), odd(config(0.6), 10), no_minimum(config(0.6, 0), 64), full_minimum(config(0.6, 1), 64);
  EXPECT_FALSE(quarter.may_end_with(14));
  EXPECT_TRUE(quarter.may_end_with(15));
  EXPECT_FALSE(odd.may_end_with(1));  // 2 of 10 are less than a quarter
  EXPECT_TRUE(odd.may_end_with(2));
  EXPECT_TRUE(no_minimum.may_end_with(0));  // a rollout has one step
  EXPECT_FALSE(full_minimum.may_end_with(62));
}

TEST(Preemption, OnceEnoughOthersWait) {
  const Preemption eight(config(0.6), 64);
  EXPECT_FALSE(eight.ends_with(20, 1, 4, 8));
  EXPECT_TRUE(eight.ends_with(20, 1, 5, 8));                        // 4.8 of 8
  EXPECT_TRUE(Preemption(config(0.6), 64).ends_with(20, 1, 3, 5));  // 0.6 x 5 is 3, whatever its rounding
  EXPECT_FALSE(Preemption(config(0.01), 64).ends_with(20, 1, 0, 8));
}

TEST(Preemption, ExpectsTheOthersWhenTheyWereThereBefore) {
  Preemption eight(config(0.6), 64);
  EXPECT_TRUE(std::isinf(eight.expected_s()));
  eight.note_update(rollouts(7));
  EXPECT_DOUBLE_EQ(eight.expected_s(), 1.04);  // the fifth
  eight.note_update(rollouts(5));
  EXPECT_DOUBLE_EQ(eight.expected_s(), 1.04);
  // Where too few made all, nothing is known: those that were cut short have no say.
  eight.note_update(rollouts(4));
  EXPECT_TRUE(std::isinf(eight.expected_s()));
}

TEST(Preemption, ASlowWorkerBeginsNoStepThatOthersWouldWaitFor) {
  Preemption eight(config(0.6), 64);
  eight.note_update(rollouts(7));
  // 0.0625 s a step, four times that of the others, and 0.06: the sixteenth step ends at 1, the seventeenth would end at 1.0625.
  EXPECT_TRUE(eight.ends_with(15, 16 * 0.0625, 0, 8));
  EXPECT_FALSE(eight.ends_with(15, 16 * 0.06, 0, 8));
  EXPECT_TRUE(eight.ends_with(16, 17 * 0.06, 0, 8));
  // One that is a fifth slower than the others is not slow: it goes on until they wait.
  const double step_s = 1.2 * 1.04 / 64;
  for (int step = 15; step < 63; ++step) EXPECT_FALSE(eight.ends_with(step, (step + 1) * step_s, 0, 8)) << step;
  EXPECT_TRUE(eight.ends_with(60, 61 * step_s, 5, 8));
}

}  // namespace
}  // namespace earshot
