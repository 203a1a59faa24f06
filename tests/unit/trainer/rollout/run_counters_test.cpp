// SPDX-License-Identifier: Apache-2.0
#include "trainer/rollout/run_counters.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace earshot {
namespace {

using testing::Contains;
using testing::Pair;

TEST(RunCounters, FaultsAreNamedOnceEachAndCounted) {
  RunCounters counters;
  EXPECT_EQ(fault_summary(counters, {}), "");
  counters.values[RunCounters::quarantined] = 2;
  counters.values[RunCounters::ratio_alarms] = 1;
  EXPECT_EQ(fault_summary(counters, {.skipped_steps = 3}), "2 episodes quarantined, 3 steps skipped, 1 ratio alarm");
}

TEST(RunCounters, CurvesHoldTotalsOfGuardsAndFractionsOfRecentPoses) {
  RunCounters before, now;
  before.values[RunCounters::poses] = 100;
  before.values[RunCounters::in_sight] = 100;
  now.values[RunCounters::poses] = 140;
  now.values[RunCounters::in_sight] = 110;
  now.values[RunCounters::ratio_alarms] = 4;
  std::vector<std::pair<std::string, double>> values;
  append_curve_values(values, now, before, {.kl_alarms = 5});
  EXPECT_THAT(values, Contains(Pair("hearing/in_sight", 0.25)));
  EXPECT_THAT(values, Contains(Pair("guards/ratio_alarms", 4)));
  EXPECT_THAT(values, Contains(Pair("guards/kl_alarms", 5)));
}

}  // namespace
}  // namespace earshot
